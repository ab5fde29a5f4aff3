"""PLY, STL and glTF through trimesh, scenes flattened, companions confined to the folder."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

import numpy as np

from kiribench.errors import Fault, MeshError
from kiribench.surface.files import inside_folder
from kiribench.surface.mesh import Mesh

# trimesh has no error type of its own: these are what its readers were seen to raise, or can,
# on damaged files (tests/scan_zoo.py).
_READER_ERRORS = (
    ArithmeticError,
    AssertionError,
    AttributeError,
    EOFError,
    ImportError,
    LookupError,
    MemoryError,
    NameError,
    OSError,
    RecursionError,
    RuntimeError,
    TypeError,
    ValueError,
    struct.error,
)


def read_other(path: Path) -> tuple[Mesh, tuple[Fault, ...]]:
    """Read ``path`` with trimesh; vertices stay in the file's unit.

    Every geometry of a scene is placed by its transform and joined into one mesh, without
    merging vertices (that is ``repair_mesh``'s work, and reported by it).

    Raises:
        MeshError: ``mesh-unreadable`` or ``mesh-no-faces``.
    """
    import trimesh
    from trimesh.exchange.stl import HeaderError

    faults: list[Fault] = []
    folder = path.parent

    class Confined(trimesh.resolvers.Resolver):
        """Hands trimesh the files inside the scan's folder, and only these."""

        def __init__(self, *_: Any, **__: Any) -> None: ...

        def get(self, name: str) -> bytes:
            found = inside_folder(folder, name, scan=path, what="companion file")
            if isinstance(found, Fault):
                faults.append(found)
                raise FileNotFoundError(name)
            return found.read_bytes()

        def keys(self) -> list[str]:
            return []

        def write(self, name: str, data: bytes) -> None:
            raise PermissionError(name)

        def namespaced(self, namespace: str) -> Confined:
            return Confined()

    try:
        with path.open("rb") as stream:
            scene = trimesh.load_scene(
                stream,
                file_type=path.suffix[1:].lower(),
                resolver=Confined(),
                process=False,
                maintain_order=True,
            )
        mesh = _flattened(scene, trimesh.Trimesh)
    except (*_READER_ERRORS, HeaderError) as error:
        if faults:
            raise MeshError.of(
                Fault(
                    fault.code,
                    fault.what,
                    remedy="Export the scan as one self-contained file (GLB).",
                    file=str(path),
                    got=fault.got,
                )
                for fault in faults
            ) from error
        reason = str(error).strip().split("\n")[0][:120]
        raise MeshError(
            "mesh-unreadable",
            f"The {path.suffix[1:].upper()} file cannot be read "
            f"({type(error).__name__}: {reason}).",
            remedy="It is damaged or cut off; export it again, best as OBJ.",
            file=path,
        ) from error
    if mesh is None:
        raise MeshError(
            "mesh-no-faces",
            "The file holds no face.",
            remedy="Export the scan as a mesh, not as a point cloud; or the file was cut off.",
            file=path,
        )
    _refuse_bad_indices(path, mesh)
    return mesh, tuple(faults)


def _flattened(scene: Any, kind: type) -> Mesh | None:
    """All triangle meshes of the scene as one; None if there is none."""
    vertices, faces, uvs, colours = [], [], [], []
    count = 0
    for node in scene.graph.nodes_geometry:
        transform, name = scene.graph[node]
        part = scene.geometry[name]
        if not isinstance(part, kind) or len(part.faces) == 0:  # type: ignore[attr-defined]
            continue
        part_any: Any = part
        xyz = np.asarray(part_any.vertices, dtype=np.float64)
        if not np.array_equal(transform, np.eye(4)):
            xyz = xyz @ transform[:3, :3].T + transform[:3, 3]
        triangles = np.asarray(part_any.faces, dtype=np.int64)
        if np.linalg.det(transform[:3, :3]) < 0:
            triangles = triangles[:, ::-1]
        vertices.append(xyz)
        faces.append(triangles + count)
        uvs.append(_uv(part_any))
        colours.append(_colours(part_any))
        count += len(xyz)
    if not vertices:
        return None
    joined = np.concatenate(faces)
    if count > np.iinfo(np.int32).max:
        raise ValueError("more vertices than 32-bit indices can name")
    indices = np.clip(joined, -1, np.iinfo(np.int32).max).astype(np.int32)
    uv = None if any(part is None for part in uvs) else np.concatenate(uvs)
    return Mesh(
        vertices_mm=np.ascontiguousarray(np.concatenate(vertices)),
        faces=np.ascontiguousarray(indices),
        uv=uv,
        face_uv=None if uv is None else np.ascontiguousarray(indices),
        colours=None if any(part is None for part in colours) else np.concatenate(colours),
        texture=None,
    )


def _uv(part: Any) -> Any:
    if part.visual.kind != "texture" or part.visual.uv is None:
        return None
    uv = np.asarray(part.visual.uv, dtype=np.float64)
    return uv[:, :2] if uv.ndim == 2 and len(uv) == len(part.vertices) else None


def _colours(part: Any) -> Any:
    if part.visual.kind != "vertex":
        return None
    rgba = np.asarray(part.visual.vertex_colors)
    return rgba[:, :3].astype(np.uint8) if len(rgba) == len(part.vertices) else None


def _refuse_bad_indices(path: Path, mesh: Mesh) -> None:
    count = len(mesh.vertices_mm)
    bad = np.flatnonzero(((mesh.faces < 0) | (mesh.faces >= count)).any(axis=1))
    if len(bad):
        raise MeshError(
            "mesh-index-range",
            f"{len(bad)} faces name vertices that do not exist; the first is face {bad[0]}.",
            remedy="The file is damaged or cut off; export it again.",
            file=path,
            got=mesh.faces[bad[0]].tolist(),
            expected=f"0 to {count - 1}",
        )
