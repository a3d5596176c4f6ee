"""Skips the tests that render if EGL is missing."""

import moderngl
import pytest


def has_egl() -> bool:
    """Returns whether an OpenGL context can be made without a screen."""
    try:
        moderngl.create_context(standalone=True, backend="egl").release()
    except Exception:  # the kind of error depends on the missing library
        return False
    return True


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Marks the tests to skip."""
    marked = [item for item in items if item.get_closest_marker("egl")]
    if marked and not has_egl():
        for item in marked:
            item.add_marker(pytest.mark.skip(reason="EGL is missing (apt-get install libegl1 libgl1-mesa-dri)"))
