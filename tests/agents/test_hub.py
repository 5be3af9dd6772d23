"""Runs go to and from a hub as numbers, graphs and configs; a small server stands in for it."""

from __future__ import annotations

import base64
import hashlib
import json
import threading
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import pytest
from huggingface_hub import constants
from sealegs.agents import hub
from sealegs.common.errors import SealegsError

COMMIT = "a" * 40


class Hub(BaseHTTPRequestHandler):
    """The hub's answers that an upload and a download of small files need."""

    files: dict[str, bytes]

    def log_message(self, *_: Any) -> None: ...

    def _say(self, document: Any, status: int = 200, **headers: str) -> None:
        body = document if isinstance(document, bytes) else json.dumps(document).encode()
        self.send_response(status)
        for name, value in {"Content-Length": str(len(body)), **headers}.items():
            self.send_header(name.replace("_", "-"), value)
        self.end_headers()
        if self.command != "HEAD":
            self.wfile.write(body)

    def do_POST(self) -> None:
        body = self.rfile.read(int(self.headers["Content-Length"]))
        if self.path.endswith("/repos/create"):
            self._say({"url": f"http://{self.headers['Host']}/me/hopper"})
        elif "/preupload/" in self.path:
            rows = [
                {"path": item["path"], "uploadMode": "regular", "shouldIgnore": False}
                for item in json.loads(body)["files"]
            ]
            self._say({"files": rows})
        elif "/commit/" in self.path:
            for line in map(json.loads, body.splitlines()):
                if line["key"] == "file":
                    self.files[line["value"]["path"]] = base64.b64decode(line["value"]["content"])
            self._say(
                {
                    "success": True,
                    "commitOid": COMMIT,
                    "commitUrl": f"http://{self.headers['Host']}/me/hopper/commit/{COMMIT}",
                }
            )
        else:
            self._say({"files": []})

    def do_GET(self) -> None:
        path = self.path.partition("?")[0]
        if path.startswith("/api/") and "/tree/" in path:
            self._say(
                [
                    {"type": "file", "path": name, "size": len(data), "oid": hashlib.sha1(data).hexdigest()}
                    for name, data in self.files.items()
                ]
            )
        elif path.startswith("/api/"):
            if "none" in path:
                self._say({"error": "Repository not found"}, 404, X_Error_Code="RepoNotFound")
                return
            self._say({"id": "me/hopper", "sha": COMMIT, "siblings": [{"rfilename": name} for name in self.files]})
        else:
            data = self.files[path.partition(f"/resolve/{COMMIT}/")[2]]
            self._say(data, ETag=f'"{hashlib.sha1(data).hexdigest()}"', X_Repo_Commit=COMMIT)

    do_HEAD = do_GET


@pytest.fixture
def served(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[dict[str, bytes]]:
    """Files of a repository ``me/hopper`` on a hub of this machine."""
    kind = type("Served", (Hub,), {"files": {}})
    server = ThreadingHTTPServer(("127.0.0.1", 0), kind)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    endpoint = f"http://127.0.0.1:{server.server_port}"
    monkeypatch.setattr(constants, "ENDPOINT", endpoint)
    monkeypatch.setattr(constants, "HUGGINGFACE_CO_URL_TEMPLATE", endpoint + "/{repo_id}/resolve/{revision}/{filename}")
    monkeypatch.setattr(constants, "HF_HUB_CACHE", str(tmp_path / "cache"))
    monkeypatch.setenv("HF_TOKEN", "hf_" + "x" * 34)
    yield kind.files
    server.shutdown()


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """A folder like that of a run."""
    folder = tmp_path / "first"
    content = {
        "config.yaml": "seed: 0",
        "actuators.yaml": "{}",
        "run.json": '{"command": "/home/me"}',
        "sources.json": "{}",
    }
    for kind in ("best", "final"):
        content |= {
            f"{kind}/policy.json": '{"step": 64}',
            f"{kind}/policy.safetensors": "numbers",
            f"{kind}/policy.onnx": "graph",
        }
        content |= {f"{kind}/model.zip": "pickle", f"{kind}/vecnormalize.pkl": "pickle"}
    content |= {
        "checkpoints/000000000064/policy.safetensors": "numbers",
        "tensorboard/events.json": "{}",
        "video.mp4": "film",
    }
    for name, text in content.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text)
    return folder


SHARED = {"actuators.yaml", "config.yaml"} | {
    f"{kind}/policy.{ending}" for kind in ("best", "final") for ending in ("json", "onnx", "safetensors")
}


def test_a_run_leaves_as_numbers_graphs_and_configs_and_comes_back(
    run: Path, served: dict[str, bytes], tmp_path: Path
) -> None:
    assert hub.upload(run, "me/hopper").endswith("/me/hopper")
    served.pop(".gitattributes", None)
    assert set(served) == SHARED
    served["best/model.zip"] = served["hostile.pkl"] = b"pickle"
    there = hub.download("me/hopper", tmp_path / "theirs")
    assert {path.relative_to(there).as_posix() for path in there.rglob("*") if path.is_file()} == SHARED
    assert (there / "best" / "policy.safetensors").read_text() == "numbers"
    with pytest.raises(SealegsError, match="never overwritten"):
        hub.download("me/hopper", there)


def test_a_folder_of_seeds_leaves_with_its_table(run: Path) -> None:
    study = run.parent / "study"
    study.mkdir()
    run.rename(study / "seed0")
    (study / "seeds.json").write_text("{}")
    assert {path.as_posix() for path in hub.shared_files(study)} == {"seeds.json"} | {
        f"seed0/{name}" for name in SHARED
    }


def test_what_goes_wrong_is_a_sentence(served: dict[str, bytes], tmp_path: Path) -> None:
    with pytest.raises(SealegsError, match="is no run with a policy"):
        hub.upload(tmp_path, "me/hopper")
    with pytest.raises(SealegsError, match="does not give or take me/none"):
        hub.download("me/none", tmp_path / "theirs")
    served["notes.json"] = b"{}"
    with pytest.raises(SealegsError, match="me/hopper holds no policy"):
        hub.download("me/hopper", tmp_path / "theirs")
    with pytest.raises(SealegsError, match="say sealegs hub upload"):
        hub.main(["upload"])
    assert not (tmp_path / "theirs").exists()


def test_a_hub_that_does_not_answer_is_a_sentence(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(constants, "ENDPOINT", "http://127.0.0.1:9")
    with pytest.raises(SealegsError, match="does not give or take me/hopper"):
        hub.download("me/hopper", tmp_path / "theirs")
