"""Optional dependencies."""

from importlib import import_module
from typing import Any


def extra(module: str, name: str | None = None) -> Any:
    """Imports an optional module.

    Raises:
        ImportError: it is not installed; the message names the extra of this package that installs it.
    """
    try:
        return import_module(module)
    except ImportError as missing:
        raise ImportError(f"{module} is not installed: pip install 'roadplane[{name or module}]'") from missing
