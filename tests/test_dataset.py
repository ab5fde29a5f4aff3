"""Subject folders: what is found, what is refused, and what is said about it."""

from __future__ import annotations

import csv
import json
import os
import shutil
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from small_limb import ELBOW, ELBOW_REGIONS, Limb, write_dataset, write_elbow_dataset, write_nodes
from tolerances import NODE_TEXT_MM

from kiribench.dataset import ACQUISITIONS, Dataset, check_dataset
from kiribench.dataset.poses import bend_deg, handedness
from kiribench.errors import DatasetError, Fault, UsageError

DATA = Path(__file__).parent / "data"
SURF = "sub-A/surf"
NODES = f"{SURF}/sub-A_acq-flex000_nodes.tsv"
SCAN = f"{SURF}/sub-A_acq-flex000_scan.obj"
SIDECAR = f"{SURF}/sub-A_acq-flex000_scan.json"
NOBODY = 65534


@pytest.fixture(scope="session")
def pristine(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_dataset(tmp_path_factory.mktemp("pristine") / "limb")


@pytest.fixture
def dataset(pristine: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(pristine, tmp_path / "limb"))


def codes(faults: tuple[Fault, ...], severity: str = "error") -> set[str]:
    return {fault.code for fault in faults if fault.severity == severity}


def edit_json(path: Path, **keys: object) -> None:
    value = json.loads(path.read_text(encoding="utf-8")) | keys
    path.write_text(json.dumps({k: v for k, v in value.items() if v is not None}), encoding="utf-8")


def test_pristine_dataset_has_no_fault(pristine: Path) -> None:
    assert check_dataset(pristine) == ()


def test_what_a_dataset_gives(pristine: Path) -> None:
    dataset = Dataset.open(pristine)
    assert dataset.description.name == "analytic limb"
    assert dataset.participants == ("A",)
    subject = dataset.subject("A")
    assert (subject.id, subject.side, subject.faults) == ("A", "right", ())
    limb = Limb()
    for name in ACQUISITIONS:
        assert subject.has(name)
        assert subject.scan_path(name) == pristine / SURF / f"sub-A_acq-{name}_scan.obj"
        assert subject.scan_sidecar(name).units == "mm"
        assert subject.scan_sidecar(name).flexion_angle == (0 if name == "flex000" else 90)
    np.testing.assert_allclose(
        subject.nodes("flex090").grid_xyz_mm(), limb.nodes("flex090"), rtol=0, atol=NODE_TEXT_MM
    )
    assert subject.nodes("flex090worn").grid_shape == (13, 7)
    assert len(subject.files) == 9


def test_participant_is_found_with_and_without_its_prefix(pristine: Path) -> None:
    dataset = Dataset.open(pristine)
    assert dataset.subject("sub-A").id == "A"
    assert [subject.id for subject in dataset.subjects()] == ["A"]
    for wrong in ("B", "../A", "", "sub-"):
        with pytest.raises(UsageError) as caught:
            dataset.subject(wrong)
        assert caught.value.code == "participant-unknown"


def test_elbow_by_metadata_alone(tmp_path: Path) -> None:
    root = write_elbow_dataset(tmp_path / "elbow")
    assert check_dataset(root) == ()
    subject = Dataset.open(root).subject("E1")
    assert subject.side == "left"
    assert subject.layout.body_part == "elbow"
    assert subject.layout.patch_offset == (1, 1)
    assert subject.layout.regions.names == ("cap", "outer", "hollow", "inner")
    assert subject.nodes("flex000").grid_shape == (ELBOW.rows + 1, ELBOW.columns + 1)
    assert subject.nodes("flex090worn").grid_shape == (7, 5)


@pytest.mark.parametrize(
    "shape",
    ["A_male_athletic_dqs", "A_male_athletic_lbs", "B_female_average_dqs", "B_female_average_lbs"],
)
def test_independent_body_geometry_from_the_issue_text_alone(shape: str, tmp_path: Path) -> None:
    """The barest folder that follows the format: no table of participants, no README."""
    surf = tmp_path / SURF
    surf.mkdir(parents=True)
    (tmp_path / "dataset_description.json").write_text('{"Name": "anny"}', encoding="ascii")
    with (DATA / "anny_knee" / f"{shape}_markers.csv").open(encoding="ascii") as stream:
        markers = list(csv.DictReader(stream))
    for angle in ("00", "90"):
        stem = f"sub-A_acq-flex0{angle}"
        shutil.copy(DATA / "anny_knee" / f"{shape}_{angle}deg.obj", surf / f"{stem}_scan.obj")
        (surf / f"{stem}_scan.json").write_text(
            json.dumps({"Units": "mm", "FlexionAngle": int(angle), "Side": "right"})
        )
        lines = ["row\tcol\tx_mm\ty_mm\tz_mm"] + [
            "\t".join(m[key] for key in ("row", "col", f"x_{angle}", f"y_{angle}", f"z_{angle}"))
            for m in markers
        ]
        (surf / f"{stem}_nodes.tsv").write_text("\n".join(lines), encoding="ascii")
    faults = check_dataset(tmp_path)
    assert codes(faults) == set()
    assert codes(faults, "warning") == {"participants-missing", "readme-missing"}
    subject = Dataset.open(tmp_path).subject("A")
    assert subject.has("flex000")
    assert subject.has("flex090")
    assert not subject.has("flex090worn")
    # The same knee on the other side must be refused: the check sees real geometry.
    for angle in ("00", "90"):
        edit_json(surf / f"sub-A_acq-flex0{angle}_scan.json", Side="left")
    assert codes(check_dataset(tmp_path)) == {"grid-mirrored"}


def test_lenient_where_harmless(dataset: Path) -> None:
    edit_json(dataset / "dataset_description.json", BIDSVersion="1.9.0", License="CC0")
    (dataset / "derivatives" / "kiribench" / "sub-A").mkdir(parents=True)
    (dataset / SURF / "sub-A_acq-flex000_scan.mtl").write_text("newmtl skin\n")
    (dataset / SURF / "notes.txt").write_text("left shoe\n")
    (dataset / SURF / "sub-A_acq-flex045_scan.obj").write_text("v 0 0 0\n")
    lines = (dataset / NODES).read_text().splitlines()
    lines = [lines[0] + "\tquality\tstatus", *[line + "\tgood\t" for line in lines[1:]]]
    (dataset / NODES).write_text("\r\n".join(lines))
    assert check_dataset(dataset) == ()


def test_worn_scan_is_optional(dataset: Path) -> None:
    for path in (dataset / SURF).glob("*worn*"):
        path.unlink()
    assert check_dataset(dataset) == ()
    subject = Dataset.open(dataset).subject("A")
    assert subject.scan_path("flex090worn") is None
    with pytest.raises(DatasetError) as caught:
        subject.nodes("flex090worn")
    assert caught.value.code == "acquisition-missing"


def test_other_scan_formats_are_found(dataset: Path) -> None:
    scan = dataset / SURF / "sub-A_acq-flex000_scan.obj"
    for suffix in (".PLY", ".stl", ".glb", ".gltf", ".OBJ"):
        scan = scan.rename(scan.with_suffix(suffix))
        assert check_dataset(dataset) == ()
        assert Dataset.open(dataset).subject("A").scan_path("flex000") == scan


def test_side_from_the_table_alone_and_from_nowhere(dataset: Path) -> None:
    for path in (dataset / SURF).glob("*_scan.json"):
        edit_json(path, Side=None)
    assert Dataset.open(dataset).subject("A").side == "right"
    (dataset / "participants.tsv").write_text("participant_id\nsub-A\n")
    assert codes(check_dataset(dataset)) == {"side-missing"}


def test_side_contradiction_names_both_files(dataset: Path) -> None:
    edit_json(dataset / SIDECAR, Side="left")
    faults = [f for f in check_dataset(dataset) if f.code == "side-contradiction"]
    assert len(faults) == 1
    assert "participants.tsv" in str(faults[0].got)
    assert SIDECAR in str(faults[0].got)


def test_mirrored_elbow_is_seen(tmp_path: Path) -> None:
    root = write_elbow_dataset(tmp_path / "elbow")
    (root / "participants.tsv").unlink()
    for path in (root / "sub-E1" / "surf").glob("*_scan.json"):
        edit_json(path, Side="right")
    faults = [fault for fault in check_dataset(root) if fault.severity == "error"]
    assert [fault.code for fault in faults] == ["grid-mirrored"] * 3


def test_body_part_without_sides_is_not_checked_for_handedness(dataset: Path) -> None:
    for path in (dataset / SURF).glob("*_scan.json"):
        edit_json(path, Side="none")
    (dataset / "participants.tsv").write_text("participant_id\nA\n")
    assert check_dataset(dataset) == ()
    assert Dataset.open(dataset).subject("A").side == "none"


def test_a_broken_subject_does_not_hide_the_others(tmp_path: Path) -> None:
    root = write_dataset(tmp_path / "two", participants=("A", "B"))
    (root / NODES).write_text("row,col\n")
    dataset = Dataset.open(root)
    dataset.subject("B").require("flex000", "flex090")
    with pytest.raises(DatasetError) as caught:
        dataset.subject("A").require("flex000", "flex090")
    assert caught.value.code == "table-separator"
    with pytest.raises(DatasetError):
        dataset.subject("A").nodes("flex000")
    assert not dataset.subject("A").has("flex000")


def test_every_fault_of_every_subject_at_once(tmp_path: Path) -> None:
    root = write_dataset(tmp_path / "two", participants=("A", "B"))
    edit_json(root / SIDECAR, Units="furlong")
    (root / "sub-A/surf/sub-A_acq-flex090_nodes.tsv").unlink()
    (root / "sub-B/surf/sub-B_acq-flex000_scan.obj").unlink()
    (root / "participants.tsv").write_text("participant_id\tside\nA\tright\nC\tup\n")
    assert codes(check_dataset(root)) == {
        "json-value",
        "nodes-missing",
        "scan-missing",
        "participant-without-folder",
        "participant-side",
    }


def test_layout_of_one_subject(tmp_path: Path) -> None:
    root = write_dataset(tmp_path / "small", Limb(rows=8, columns=6, patch_rows=4, patch_columns=4))
    assert codes(check_dataset(root)) == {"nodes-edge-missing"}
    (root / "sub-A" / "sub-A_layout.json").write_text(
        json.dumps({"Grid": {"Rows": 8, "Columns": 6}, "Patch": {"Rows": 4, "Columns": 4}})
    )
    assert check_dataset(root) == ()
    subject = Dataset.open(root).subject("A")
    assert subject.layout.patch_offset == (2, 1)
    assert Dataset.open(root).layout.patch_offset == (2, 3)


@pytest.mark.parametrize(
    ("text", "code"),
    [
        ('{"Grid": {"Rows": 8.5}}', "json-value"),
        ('{"Patch": {"Rows": 40}}', "patch-outside-grid"),
        ("{", "json-syntax"),
    ],
)
def test_wrong_layout_of_one_subject(dataset: Path, text: str, code: str) -> None:
    (dataset / "sub-A" / "sub-A_layout.json").write_text(text)
    faults = check_dataset(dataset)
    assert codes(faults) == {code}
    assert faults[0].file == "sub-A/sub-A_layout.json"
    with pytest.raises(DatasetError):
        Dataset.open(dataset).subject("A").nodes("flex000")


def test_examples_of_the_format_reference(tmp_path: Path) -> None:
    text = (Path(__file__).parents[1] / "docs" / "subject-folders.md").read_text(encoding="utf-8")
    smallest, scan, elbow = (block.split("```")[0] for block in text.split("```json\n")[1:])
    root = write_elbow_dataset(tmp_path / "elbow")
    (root / "dataset_description.json").write_text(elbow, encoding="utf-8")
    assert check_dataset(root) == ()
    layout = Dataset.open(root).layout
    assert layout.regions.labels == ELBOW_REGIONS
    assert layout.patch_offset == (1, 1)
    root = write_dataset(tmp_path / "knee")
    (root / "dataset_description.json").write_text(smallest, encoding="utf-8")
    (root / SIDECAR).write_text(scan, encoding="utf-8")
    assert check_dataset(root) == ()


# --- geometry of the nodes ------------------------------------------------------------------


def rewrite(root: Path, change: Callable[[np.ndarray], np.ndarray], *poses: str) -> None:
    limb = Limb()
    for pose in poses or ACQUISITIONS:
        grid = limb.patch_nodes(0.97) if pose == "flex090worn" else limb.nodes(pose)
        write_nodes(root / SURF / f"sub-A_acq-{pose}_nodes.tsv", change(grid))


@pytest.mark.parametrize(
    ("change", "poses", "code"),
    [
        (lambda grid: grid / 1000, (), "nodes-spacing"),
        (lambda grid: grid / 10, (), "nodes-spacing"),
        (lambda grid: grid / 25.4, ("flex000",), "nodes-spacing"),
        (lambda grid: grid[:, ::-1], (), "grid-mirrored"),
        (lambda grid: grid[::-1], (), "grid-mirrored"),
        (lambda grid: grid * [-1, 1, 1], (), "grid-mirrored"),
        (lambda grid: grid * 0 + 3.0, ("flex000",), "nodes-spacing"),
    ],
)
def test_impossible_grids(
    dataset: Path,
    change: Callable[[np.ndarray], np.ndarray],
    poses: tuple[str, ...],
    code: str,
) -> None:
    rewrite(dataset, change, *poses)
    assert codes(check_dataset(dataset)) == {code}


@pytest.mark.parametrize(("factor", "unit"), [(1000, "m"), (10, "cm"), (25.4, "in")])
def test_wrong_unit_is_named(dataset: Path, factor: float, unit: str) -> None:
    rewrite(dataset, lambda grid: grid / factor, "flex000")
    (fault,) = (f for f in check_dataset(dataset) if f.code == "nodes-spacing")
    assert f"seem to be in {unit}." in fault.what


def test_half_a_turn_keeps_the_handedness_and_cannot_be_seen(dataset: Path) -> None:
    """Rows and columns both reversed: nothing in the geometry tells; the docs say so."""
    rewrite(dataset, lambda grid: grid[::-1, ::-1])
    assert codes(check_dataset(dataset)) == set()


def test_poses_swapped_by_their_shape(dataset: Path) -> None:
    surf = dataset / SURF
    for kind in ("nodes.tsv", "scan.obj"):
        first, second = surf / f"sub-A_acq-flex000_{kind}", surf / f"sub-A_acq-flex090_{kind}"
        first.rename(surf / "spare")
        second.rename(first)
        (surf / "spare").rename(second)
    assert codes(check_dataset(dataset)) == {"poses-swapped"}


def test_the_same_pose_twice_is_a_warning(dataset: Path) -> None:
    rewrite(dataset, lambda grid: Limb().nodes("flex000"), "flex090")
    faults = check_dataset(dataset)
    assert codes(faults) == set()
    assert codes(faults, "warning") == {"pose-not-flexed"}


def test_mirrored_on_a_straight_phantom_is_a_warning(dataset: Path) -> None:
    rewrite(dataset, lambda grid: Limb().nodes("flex000")[:, ::-1], "flex000", "flex090")
    for path in (dataset / SURF).glob("*worn*"):
        path.unlink()
    faults = check_dataset(dataset)
    assert codes(faults) == set()
    assert codes(faults, "warning") == {"grid-mirrored", "pose-not-flexed"}


@pytest.mark.parametrize(
    ("angle", "error", "warning"),
    [
        (0, set(), set()),
        (15, set(), set()),
        (-5, set(), set()),
        (30, set(), {"flexion-off"}),
        (45, set(), {"flexion-off"}),
        (46, {"flexion-contradiction"}, set()),
        (90, {"flexion-contradiction"}, set()),
        (None, set(), {"flexion-missing"}),
    ],
)
def test_flexion_angle(
    dataset: Path, angle: float | None, error: set[str], warning: set[str]
) -> None:
    edit_json(dataset / SIDECAR, FlexionAngle=angle)
    faults = check_dataset(dataset)
    assert codes(faults) == error
    assert codes(faults, "warning") == warning


def test_coincident_and_misplaced_nodes(dataset: Path) -> None:
    def change(grid: np.ndarray) -> np.ndarray:
        grid = grid.copy()
        grid[3, 4] = grid[3, 5]
        grid[9, 9] += [0, 0, 60.0]
        return grid

    rewrite(dataset, change, "flex000")
    faults = check_dataset(dataset)
    assert codes(faults) == {"nodes-coincident"}
    assert codes(faults, "warning") == {"nodes-outlier"}
    assert any("node (3, 4)" in f.what and "node (3, 5)" in f.what for f in faults)


@pytest.mark.parametrize(("apart_mm", "found"), [(0.2, True), (0.4, False)])
def test_nodes_nearer_than_a_fiftieth_of_the_pitch_coincide(
    dataset: Path, apart_mm: float, found: bool
) -> None:
    def change(grid: np.ndarray) -> np.ndarray:
        grid = grid.copy()
        grid[3, 4] = grid[3, 5] + [0, 0, apart_mm]
        return grid

    rewrite(dataset, change, "flex000")
    assert codes(check_dataset(dataset)) == ({"nodes-coincident"} if found else set())


@pytest.mark.parametrize(("mean_bulge", "decisive"), [(0.035, True), (0.025, False)])
@pytest.mark.parametrize("side", ["right", "left"])
def test_handedness_of_a_shallow_arc(mean_bulge: float, decisive: bool, side: str) -> None:
    """A parabola of height h over a chord c: inner nodes lie 2/3 h (1 + O(1/n^2)) above it."""
    chord, nodes = 180.0, 13
    u = np.linspace(0.0, 1.0, nodes)
    weight = 4 * u[1:-1] * (1 - u[1:-1])
    height = mean_bulge * chord / weight.mean()
    arc = np.stack([chord * (0.5 - u), 4 * height * u * (1 - u), 0 * u], axis=-1)
    grid = arc[None] - np.arange(5.0)[:, None, None] * [0.0, 0.0, 15.0]
    if side == "left":
        grid = grid * [-1.0, 1.0, 1.0]
    found = handedness(grid)
    assert found.bulge == pytest.approx(mean_bulge if side == "right" else -mean_bulge, rel=1e-12)
    assert found.decisive == decisive


def test_handedness_needs_curvature() -> None:
    flat = np.stack(np.meshgrid(np.arange(5.0), np.arange(5.0), [0.0], indexing="ij"), axis=-1)
    assert not handedness(flat.reshape(5, 5, 3)).decisive
    assert not handedness(np.full((5, 5, 3), np.nan)).decisive
    assert bend_deg(np.full((5, 5, 3), np.nan)) is None


def test_bend_is_the_arc_between_the_ends() -> None:
    limb = Limb()
    # The ends are chords of 3 of 16 cells: their directions are 13 cells of arc apart.
    expected = np.degrees(13 * limb.pitch_mm / limb.bend_radius_mm)
    assert bend_deg(limb.nodes("flex090")) == pytest.approx(expected, abs=1e-9)
    assert bend_deg(limb.nodes("flex000")) == pytest.approx(0.0, abs=1e-5)


# --- paths ----------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["sub-<script>", "sub-a b", "sub-", "sub-é", "sub-A.B", "sub-A_1"])
def test_bad_folder_names(dataset: Path, name: str) -> None:
    (dataset / name).mkdir()
    faults = check_dataset(dataset)
    assert codes(faults) == {"participant-id"}
    assert all(str(fault).isascii() or name == "sub-é" for fault in faults)


@pytest.mark.parametrize("label", ["../../etc", "<b>A</b>", "A/B", "..", "A\u202eB", "x" * 65])
def test_bad_ids_in_the_table(dataset: Path, label: str) -> None:
    (dataset / "participants.tsv").write_text(
        f"participant_id\tside\nA\tright\n{label}\tright\n", encoding="utf-8"
    )
    assert codes(check_dataset(dataset)) == {"participant-id"}


def test_links_may_not_lead_out(dataset: Path, tmp_path: Path) -> None:
    outside = tmp_path / "outside.json"
    outside.write_text('{"Units": "mm"}')
    (dataset / SIDECAR).unlink()
    (dataset / SIDECAR).symlink_to(outside)
    scan = dataset / SURF / "sub-A_acq-flex090_scan.obj"
    shutil.move(scan, tmp_path / "scan.obj")
    scan.symlink_to("../../../scan.obj")
    faults = check_dataset(dataset)
    assert [fault.file for fault in faults if fault.code == "path-outside"] == [
        SIDECAR,
        f"{SURF}/sub-A_acq-flex090_scan.obj",
    ]


def test_linked_subject_folder_may_not_lead_out(dataset: Path, tmp_path: Path) -> None:
    shutil.move(dataset / "sub-A", tmp_path / "sub-A")
    (dataset / "sub-A").symlink_to(tmp_path / "sub-A", target_is_directory=True)
    assert "path-outside" in codes(check_dataset(dataset))


def test_links_inside_the_dataset_are_followed(dataset: Path) -> None:
    store = dataset / ".git" / "annex"
    store.mkdir(parents=True)
    shutil.move(dataset / NODES, store / "key")
    (dataset / NODES).symlink_to("../../.git/annex/key")
    assert check_dataset(dataset) == ()


def test_dataset_behind_a_link(dataset: Path, tmp_path: Path) -> None:
    link = tmp_path / "link"
    link.symlink_to(dataset, target_is_directory=True)
    assert check_dataset(link) == ()


def test_links_in_a_circle_and_into_nothing(dataset: Path) -> None:
    (dataset / SIDECAR).unlink()
    (dataset / SIDECAR).symlink_to((dataset / SIDECAR).name)
    (dataset / NODES).unlink()
    (dataset / NODES).symlink_to("nowhere.tsv")
    assert codes(check_dataset(dataset)) <= {"path-unreadable", "path-not-a-file"}
    assert len(codes(check_dataset(dataset))) >= 1


@pytest.mark.parametrize("name", [SIDECAR, NODES, "dataset_description.json", "participants.tsv"])
def test_folder_with_a_files_name(dataset: Path, name: str) -> None:
    (dataset / name).unlink()
    (dataset / name).mkdir()
    faults = [fault for fault in check_dataset(dataset) if fault.severity == "error"]
    assert [(fault.code, fault.file) for fault in faults] == [("path-not-a-file", name)]


def test_pipe_with_a_files_name_does_not_hang(dataset: Path) -> None:
    (dataset / NODES).unlink()
    os.mkfifo(dataset / NODES)
    assert codes(check_dataset(dataset)) == {"path-not-a-file"}


@pytest.fixture
def as_nobody(pristine: Path) -> Iterator[Path]:
    """A dataset that belongs to somebody who is not root, as whom the test goes on."""
    assert check_dataset(pristine) == ()  # imports what nobody could not
    folder = Path(tempfile.mkdtemp())
    root = Path(shutil.copytree(pristine, folder / "limb"))
    is_root = os.geteuid() == 0
    if is_root:
        for path in (folder, root, *root.rglob("*")):
            os.chown(path, NOBODY, NOBODY)
        os.seteuid(NOBODY)
    try:
        yield root
    finally:
        if is_root:
            os.seteuid(0)
        shutil.rmtree(folder)


@pytest.mark.parametrize(
    "name",
    [NODES, SIDECAR, SCAN, SURF, "sub-A", ".", "participants.tsv", "dataset_description.json"],
)
def test_permission_denied(as_nobody: Path, name: str) -> None:
    path = as_nobody / name
    mode = path.stat().st_mode
    path.chmod(0)
    try:
        assert codes(check_dataset(as_nobody)) == {"path-unreadable"}
        with pytest.raises(DatasetError) as caught:
            dataset = Dataset.open(as_nobody)
            assert all(path.name != name for path in dataset.files)
            dataset.subject("A").require("flex000", "flex090")
        assert caught.value.code == "path-unreadable"
    finally:
        path.chmod(mode)


@pytest.mark.parametrize("wrong", ["nowhere", "limb/README", "a\0b"])
def test_no_dataset_there(dataset: Path, wrong: str) -> None:
    root = dataset.parent / wrong
    assert codes(check_dataset(root)) == {"dataset-missing"}
    with pytest.raises(DatasetError):
        Dataset.open(root)


def test_empty_folder(tmp_path: Path) -> None:
    assert codes(check_dataset(tmp_path)) == {"description-missing", "dataset-empty"}


def test_missing_description_does_not_hide_the_subjects(dataset: Path) -> None:
    (dataset / "dataset_description.json").unlink()
    edit_json(dataset / SIDECAR, Units="furlong")
    assert codes(check_dataset(dataset)) == {"description-missing", "json-value"}
    with pytest.raises(DatasetError) as caught:
        Dataset.open(dataset)
    assert caught.value.code == "description-missing"
