"""Scenes of suites: built-in ones by name, and files."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

from pydantic import BeforeValidator

from optik.errors import InvalidInput
from optik.plugins.usage import resolve_data_file
from optik.scene import Scene

SCENES = {file.stem: str(file) for file in sorted((Path(__file__).parent / "timing" / "scenes").glob("*.toml"))}
"""Files of the built-in scenes by name."""


def _name(value: Any) -> str:
    if isinstance(value, str) and value in SCENES:
        return value
    if isinstance(value, str) and "." not in value and "/" not in value:
        raise InvalidInput("", repr(value), f"one of {', '.join(SCENES)}, or the path of a file")
    return resolve_data_file(value, "scene")


SceneName = Annotated[str, BeforeValidator(_name)]
"""The name of a built-in scene, or the path of a file."""


def scene_named(name: str, margin: float = 0.0) -> Scene:
    """Load a scene; a margin [m] replaces the scene's own."""
    scene = Scene.load(SCENES.get(name, name))
    return replace(scene, margin=margin) if margin else scene
