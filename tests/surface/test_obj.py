"""The OBJ reader: every form of line, exact numbers, agreement with trimesh."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scan_shapes import on_knee, surface_mesh
from scan_zoo import obj_text

from kiribench.errors import MeshError
from kiribench.surface.obj import ObjContent, read_obj

SQUARE = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n"


def read(tmp_path: Path, text: str | bytes, **options: int) -> ObjContent:
    path = tmp_path / "scan.obj"
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    return read_obj(path, **options)


@pytest.mark.parametrize(
    "faces",
    [
        "f 1 2 3\nf 1 3 4\n",
        "f 1 2 3 4\n",
        "f 1/1 2/2 3/3 4/4\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n",
        "vn 0 0 1\nf 1//1 2//1 3//1 4//1\n",
        "vt 0.5\nvn 0 0 1\nf 1/1/1 2/1/1 3/1/1 4/1/1\n",
        "f -4 -3 -2 -1\n",
        "f  1 \t2   3 4  \n",
        "f 1 2 \\\n3 4\n",
        "f 1 2 3 4 # a comment\n# f 1 2 9\n",
        "g skin\ns off\no leg\nusemtl a\nf 1 2 3\nusemtl b\nf 1 3 4\nl 1 2\np 1\n",
        "f 1 2 3 4",
    ],
)
@pytest.mark.parametrize("ends", ["\n", "\r\n", "\r"])
def test_all_forms_of_faces(tmp_path: Path, faces: str, ends: str) -> None:
    content = read(tmp_path, (SQUARE + faces).replace("\n", ends))
    assert content.faces.tolist() == [[0, 1, 2], [0, 2, 3]]
    assert content.faces.dtype == np.int32
    assert content.vertices.tolist() == [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]


def test_texture_corners_follow_the_fan(tmp_path: Path) -> None:
    text = SQUARE + "vt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nf 2/4 3/3 4/2 1/1\n"
    content = read(tmp_path, text)
    assert content.faces.tolist() == [[1, 2, 3], [1, 3, 0]]
    assert content.face_uv is not None
    assert content.face_uv.tolist() == [[3, 2, 1], [3, 1, 0]]


def test_negative_indices_count_from_where_they_stand(tmp_path: Path) -> None:
    text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf -3 -2 -1\nv 0 0 9\nf -4 -3 -1\n"
    assert read(tmp_path, text).faces.tolist() == [[0, 1, 2], [0, 1, 3]]


def test_faces_may_come_before_their_vertices(tmp_path: Path) -> None:
    assert read(tmp_path, "f 1 2 3\n" + SQUARE).faces.tolist() == [[0, 1, 2]]


def test_large_polygon_is_a_fan(tmp_path: Path) -> None:
    corners = 5000
    text = "".join(f"v {k} {k * k} 0\n" for k in range(corners))
    text += "f " + " ".join(str(k + 1) for k in range(corners)) + "\n" + "f 1 2 3\n"
    content = read(tmp_path, text)
    assert len(content.faces) == corners - 1
    assert content.faces[corners - 3].tolist() == [0, corners - 2, corners - 1]
    content = read(tmp_path, SQUARE + "f 1 2 3 4 1 2 3 4 1 2 3 4 1 2 3 4\n" * 9)
    assert len(content.faces) == 14 * 9


@pytest.mark.parametrize(
    ("colour", "expected"),
    [("1 0 0.5", [255, 0, 128]), ("255 0 128", [255, 0, 128]), ("0.2 0.4 0.6 1.0", [51, 102, 153])],
)
def test_vertex_colours(tmp_path: Path, colour: str, expected: list[int]) -> None:
    text = "".join(f"v {k} {k * k} 0 {colour}\n" for k in range(3)) + "f 1 2 3\n"
    content = read(tmp_path, text)
    assert content.colours is not None
    assert content.colours.tolist() == [expected] * 3
    assert content.faults == ()


def test_partly_coloured_says_so(tmp_path: Path) -> None:
    text = "v 0 0 0\nv 1 0 0 1 0 0\nv 0 1 0\nf 1 2 3\n"
    content = read(tmp_path, text)
    assert content.colours is not None
    assert content.colours.tolist() == [[255, 255, 255], [255, 0, 0], [255, 255, 255]]
    assert [fault.code for fault in content.faults] == ["obj-partial-colours"]


def test_partly_textured_says_so(tmp_path: Path) -> None:
    text = SQUARE + "vt 0.1 0.2\nvt 1 0\nvt 1 1\nf 1/1 2/2 3/3\nf 1 3 4\n"
    content = read(tmp_path, text)
    assert content.uv is not None and content.face_uv is not None
    assert content.uv[content.face_uv[1]].tolist() == [[0, 0]] * 3
    assert content.uv[content.face_uv[0, 0]].tolist() == [0.1, 0.2]
    assert [fault.code for fault in content.faults] == ["obj-partial-uv"]


def test_fourth_coordinate_is_passed_over(tmp_path: Path) -> None:
    text = SQUARE.replace(" 0\n", " 0 1.0\n") + "f 1 2 3\n"
    content = read(tmp_path, text)
    assert content.colours is None
    assert content.vertices[2].tolist() == [1, 1, 0]


@settings(max_examples=200, deadline=None, suppress_health_check=list(HealthCheck))
@given(
    st.lists(
        st.tuples(
            st.floats(-1e300, 1e300),
            st.sampled_from(
                ["{!r}", "{:.17g}", "{:.6f}", "{:.3e}", "{:+.9E}", "{:.0f}", "{:.25e}"]
            ),
        ),
        min_size=3,
        max_size=3,
    )
)
def test_numbers_are_read_as_python_reads_them(
    tmp_path: Path, numbers: list[tuple[float, str]]
) -> None:
    words = [form.format(number) for number, form in numbers]
    expected = np.array([float(word) for word in words])
    got = read(tmp_path, f"v {' '.join(words)}\nf 1 1 1\n").vertices[0]
    # Within 40 powers of ten the result is the nearest double, beyond within 3 units of it.
    near = (np.abs(expected) < 1e20) & (np.abs(expected) > 1e-20) | (expected == 0)
    assert (got[near] == expected[near]).all()
    assert np.allclose(got, expected, rtol=1e-15, atol=1e-300)


@pytest.mark.parametrize(
    ("word", "value"),
    [
        ("+.5", 0.5),
        ("5.", 5.0),
        ("-0", -0.0),
        ("1e3", 1000.0),
        ("00012", 12.0),
        ("1E-2", 0.01),
        ("12345678901234567890123", 12345678901234567890123.0),
        ("0." + "0" * 30 + "1", 1e-31),
        ("inf", np.inf),
        ("-Infinity", -np.inf),
        ("1.#INF", np.inf),
    ],
)
def test_odd_numbers(tmp_path: Path, word: str, value: float) -> None:
    got = read(tmp_path, f"v {word} 2 3\nf 1 1 1\n").vertices[0, 0]
    assert got == value
    assert np.signbit(got) == np.signbit(value)


@pytest.mark.parametrize("word", ["nan", "NaN", "-nan", "-1.#IND", "1.#QNAN", "nan(ind)"])
def test_not_a_number_is_read_as_such(tmp_path: Path, word: str) -> None:
    assert np.isnan(read(tmp_path, f"v {word} 2 3\nf 1 1 1\n").vertices[0, 0])


@pytest.mark.parametrize(
    "word", ["", ".", "-", "1e", "1e+", "1.2.3", "0x1p3", "1_000", "1,5", "nano?", "١"]
)
def test_what_is_no_number(tmp_path: Path, word: str) -> None:
    with pytest.raises(MeshError) as caught:
        read(tmp_path, f"v 1 2 3\nv 1 {word} 3 x\nf 1 1 1\n")
    assert caught.value.code == "obj-bad-number"
    assert caught.value.faults[0].row == 2


@pytest.mark.parametrize("block_bytes", [64, 100, 257, 4096])
def test_result_does_not_depend_on_the_buffer(tmp_path: Path, block_bytes: int) -> None:
    text = obj_text(surface_mesh(on_knee(60, 60), 60, 60, 12.0)).replace("f 7 ", "f \\\n 7 ")
    whole = read(tmp_path, text)
    parts = read(tmp_path, text, block_bytes=block_bytes)
    assert np.array_equal(whole.vertices, parts.vertices)
    assert np.array_equal(whole.faces, parts.faces)


@pytest.mark.parametrize("block_bytes", [64, 1 << 20])
@pytest.mark.parametrize("ends", ["\n", "\r\n", "\r"])
def test_line_numbers_count_what_an_editor_shows(
    tmp_path: Path, block_bytes: int, ends: str
) -> None:
    text = "# head\n\n" + SQUARE + "f 1 \\\n 2 3\n" * 3 + "\nf 1 2 oops\n"
    row = text[: text.index("f 1 2 oops")].count("\n") + 1
    with pytest.raises(MeshError) as caught:
        read(tmp_path, text.replace("\n", ends), block_bytes=block_bytes)
    assert caught.value.faults[0].row == row
    assert "oops" in (caught.value.faults[0].got or "")


def test_endless_line_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("kiribench.surface.obj_blocks.LONGEST_LINE_BYTES", 4096)
    with pytest.raises(MeshError) as caught:
        read(tmp_path, SQUARE + "#" * 20000, block_bytes=512)
    assert caught.value.code == "obj-line-too-long"


def test_byte_order_mark(tmp_path: Path) -> None:
    assert len(read(tmp_path, b"\xef\xbb\xbf" + (SQUARE + "f 1 2 3\n").encode()).vertices) == 4


def write_textured(folder: Path, library: str, picture: str) -> Path:
    (folder / "skin.png").write_bytes(b"picture")
    (folder / library).write_text(f"newmtl other\nKd 1 1 1\nnewmtl skin\nmap_Kd {picture}\n")
    path = folder / "scan.obj"
    text = f"mtllib {library}\n{SQUARE}vt 0 0\nusemtl skin\nf 1/1 2/1 3/1\n"
    path.write_text(text)
    return path


@pytest.mark.parametrize("library", ["scan.mtl", "my scan 1.mtl"])
@pytest.mark.parametrize("picture", ["skin.png", "-s 1 1 1 -bm 0.5 skin.png", "./skin.png"])
def test_texture_is_found_beside_the_scan(tmp_path: Path, library: str, picture: str) -> None:
    content = read_obj(write_textured(tmp_path, library, picture))
    assert content.texture == (tmp_path / "skin.png").resolve()
    assert content.faults == ()


def test_texture_in_a_folder_below(tmp_path: Path) -> None:
    (tmp_path / "maps").mkdir()
    (tmp_path / "maps" / "deep.jpg").write_bytes(b"picture")
    content = read_obj(write_textured(tmp_path, "scan.mtl", "maps\\deep.jpg"))
    assert content.texture == (tmp_path / "maps" / "deep.jpg").resolve()


@pytest.mark.parametrize("picture", ["../out.png", "maps/../../out.png", "link.png"])
def test_texture_outside_is_never_returned(tmp_path: Path, picture: str) -> None:
    folder = tmp_path / "surf"
    (folder / "maps").mkdir(parents=True)
    (tmp_path / "out.png").write_bytes(b"secret")
    (folder / "link.png").symlink_to(tmp_path / "out.png")
    content = read_obj(write_textured(folder, "scan.mtl", picture))
    assert content.texture is None
    assert [fault.code for fault in content.faults] == ["scan-path-outside"]
    assert content.faults[0].severity == "warning"


@pytest.mark.parametrize("repeated", [False, True])
def test_agrees_with_trimesh(tmp_path: Path, repeated: bool) -> None:
    """Same corners, same texture corners, on a textured knee of 20,000 faces with seams."""
    import sys

    import trimesh

    sys.path.insert(0, str(Path(__file__).parents[1] / "benchmarks"))
    from bench_obj import write_textured_obj

    path = write_textured_obj(tmp_path, "scan", 20_000)
    if repeated:  # colours instead of plain vertices, polygons beside triangles
        text = path.read_text().splitlines()
        text = [f"{line} 0.25 0.5 0.75" if line.startswith("v ") else line for line in text]
        path.write_text("\n".join(text))
    ours = read_obj(path)
    theirs = trimesh.load_mesh(path, process=False)
    assert np.array_equal(ours.vertices[ours.faces], theirs.vertices[theirs.faces])
    assert ours.uv is not None and ours.face_uv is not None
    assert np.array_equal(ours.uv[ours.face_uv], theirs.visual.uv[theirs.faces])
    assert ours.texture is not None and ours.texture.name == "scan.png"
    if repeated:
        assert ours.colours is not None
        assert (ours.colours == [64, 128, 191]).all()


DATA = Path(__file__).parents[1] / "data"


@pytest.mark.parametrize(
    "path", sorted(DATA.glob("*/*.obj")), ids=lambda path: f"{path.parent.name}-{path.stem}"
)
def test_real_files_agree_with_trimesh(path: Path) -> None:
    import trimesh

    ours = read_obj(path)
    theirs = trimesh.load_mesh(path, process=False, maintain_order=True)
    assert np.array_equal(ours.faces, theirs.faces)
    assert np.array_equal(ours.vertices, theirs.vertices)
