"""What stands around an arm, and its readers: from TOML, JSON and URDF."""

from optik.scene.model import Scene, SceneArrays

__all__ = ["Scene", "SceneArrays"]
