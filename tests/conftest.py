"""Shared fixtures."""

from pathlib import Path

import numpy as np
import pytest

SHARED_SKY = Path(__file__).resolve().parents[2] / "shared" / "sky"


@pytest.fixture(autouse=True)
def private_cache(tmp_path_factory, monkeypatch):
    """No test reads or fills the user's cache."""
    monkeypatch.setenv("HIMAP_CACHE", str(tmp_path_factory.getbasetemp() / "himap-cache"))


@pytest.fixture
def rng():
    return np.random.default_rng(12345)


@pytest.fixture(scope="session")
def real_sky():
    """Folder of the real Galaxy templates (nside 64), which the project cannot ship."""
    if not SHARED_SKY.is_dir():
        pytest.skip("the real Galaxy templates (../shared/sky) are not on this machine")
    return SHARED_SKY
