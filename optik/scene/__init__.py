"""Scenes: the objects around an arm, and their readers."""

from optik.scene.model import Scene, SceneArrays

__all__ = ["Scene", "SceneArrays"]
