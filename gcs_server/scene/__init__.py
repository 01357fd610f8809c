"""The 3D view: the only package that uses viser and ENU."""

from gcs_server.scene.clicks import SceneClick
from gcs_server.scene.gizmo import SceneGizmo
from gcs_server.scene.ports import OffboardTarget
from gcs_server.scene.scene import Scene

__all__ = ["OffboardTarget", "Scene", "SceneClick", "SceneGizmo"]
