"""Libraries of the extra `anatomy`, loaded when first needed."""

from __future__ import annotations

from importlib import import_module
from typing import Any

__all__ = ["anatomy_library"]

_PACKAGES = {
    "igl": "libigl",
    "trimesh": "trimesh",
    "nibabel": "nibabel",
    "nrrd": "pynrrd",
    "skimage.measure": "scikit-image",
}


def anatomy_library(name: str) -> Any:
    """A library of the extra `anatomy`; raises `ImportError` that says how to install it."""
    try:
        return import_module(name)
    except ImportError as error:
        package = _PACKAGES[name]
        raise ImportError(f"{package} is needed for this file: pip install 'magwire-env[anatomy]' ({error})") from None
