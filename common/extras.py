"""Optional packages: which extra of sealegs brings each of them, and the sentence where one is missing."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from .errors import SealegsError

EXTRAS = {
    "train": ("imageio", "imageio_ffmpeg", "onnx", "stable_baselines3", "tensorboard", "torch"),
    "contrib": ("sb3_contrib",),
    "sbx": ("sbx",),
    "report": ("jinja2", "matplotlib", "plotly"),
    "video": ("moviepy",),
    "hw": ("onnxruntime", "scservo_sdk", "serial"),
    "dynamixel": ("dynamixel_sdk",),
    "imu": ("adafruit_bno055", "adafruit_bno08x", "adafruit_extended_bus", "adafruit_icm20x", "adafruit_mpu6050"),
    "wandb": ("wandb",),
    "hub": ("huggingface_hub",),
    "gamepad": ("pygame",),
    "sweep": ("optuna",),
    "fleet": ("ray",),
    "hdf5": ("h5py", "pymatreader"),
    "ros": ("rosbags",),
}
"""Packages, as they are imported, by extra."""

CORE = (
    *("annotated_types", "gymnasium", "hydra", "mujoco", "numba", "numpy"),
    *("pandas", "pint", "pyarrow", "pydantic", "rich", "scipy", "sklearn", "yaml"),
)
"""Packages that every installation brings: one that is missing tells of an installation older than the code."""


class MissingPackage(SealegsError):
    """A package that is not installed, and the extra that brings it."""


def missing_package(error: ModuleNotFoundError, what: str, otherwise: str = "") -> MissingPackage | None:
    """The sentence for a package that could not be imported; None where neither sealegs nor an extra of it brings it.

    Args:
        error: of the import.
        what: that needs the package, as the subject of the sentence.
        otherwise: what else can be done.
    """
    package = (error.name or "").partition(".")[0]
    for extra, packages in EXTRAS.items():
        if package in packages:
            return MissingPackage(f"{what} needs the package {package}: pip install 'sealegs[{extra}]'{otherwise}.")
    if package in CORE:
        return MissingPackage(
            f"{what} needs the package {package}, which the installation of sealegs brings and this one has not: "
            "install sealegs again (in the checkout: make setup)."
        )
    return None


@contextmanager
def needed_for(what: str, otherwise: str = "") -> Iterator[None]:
    """Imports within say in one sentence which extra they lack.

    Raises:
        MissingPackage: a package of an extra is not installed.
    """
    try:
        yield
    except ModuleNotFoundError as error:
        raise missing_package(error, what, otherwise) or error from None
