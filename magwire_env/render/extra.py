"""Optional packages: imported when first needed, missing with one line that names the extra to install."""

from __future__ import annotations

import importlib
import os
from types import ModuleType

from gymnasium.error import DependencyNotInstalled

__all__ = ["need"]

_PACKAGES = {"pygame": "pygame-ce", "imageio_ffmpeg": "imageio-ffmpeg"}


def need(module: str, purpose: str, extra: str = "view") -> ModuleType:
    """Import `module`. Raises `DependencyNotInstalled`, one line, if it is not there."""
    os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "1")
    try:
        return importlib.import_module(module)
    except ImportError as error:
        package = _PACKAGES.get(module, module)
        raise DependencyNotInstalled(f"{purpose} needs {package}: pip install 'magwire-env[{extra}]'") from error
