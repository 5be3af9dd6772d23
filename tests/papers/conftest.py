"""What several tests of the papers look at."""

import pytest
from sealegs.papers.biped.hopping import Hopping, HoppingExperiment


@pytest.fixture(scope="session")
def hopping() -> Hopping:
    """The biped of paper 003 over its 92 hops."""
    return HoppingExperiment().run(92)
