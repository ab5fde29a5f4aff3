"""Damaged model files: an error with a name, or the same model; never other numbers."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator
from copy import deepcopy
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from safetensors import safe_open
from safetensors.numpy import save as encode
from surrogate.test_keep import SMALL, with_stress

from kiribench.errors import KiribenchError, TableError, UsageError
from kiribench.surrogate import fit_table, kept_file, load, save
from kiribench.surrogate.hyperparameters import Hyperparameters
from kiribench.surrogate.keep import SCHEMA

PLACES = 200
POINTS = (np.linspace(3.0, 97.0, 8), np.linspace(90.0, 10.0, 8), 0.3)


@pytest.fixture(scope="module")
def kept(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A Gaussian process with its second one of the stress."""
    path = tmp_path_factory.mktemp("kept") / "m.safetensors"
    stress = SMALL.longitudinal_strain * np.exp(-SMALL.a_percent / 30)
    save(fit_table(with_stress(SMALL, stress), "gp_kronecker", max_evaluations=3), path)
    return path


def numbers(path: Path) -> list[np.ndarray]:
    """All that a model says at some points."""
    model = load(path)
    both = (model.predict(*POINTS), model.predict_stress(*POINTS))
    return [np.asarray(x) for one in both for x in (one.mean, one.sd, one.inside)]


def refused_or_the_same(path: Path, whole: list[np.ndarray]) -> bool:
    """Whether it was refused; what is read must be the same, and nothing else may be raised."""
    try:
        found = numbers(path)
    except KiribenchError as error:
        assert error.faults[0].file == str(path) or isinstance(error, UsageError)
        return True
    for before, now in zip(whole, found, strict=True):
        np.testing.assert_array_equal(before, now)
    return False


def test_bytes_changed_at_random_places(kept: Path, tmp_path: Path) -> None:
    whole, content = numbers(kept), kept.read_bytes()
    header = 8 + int.from_bytes(content[:8], "little")
    rng = np.random.default_rng(0)
    # Half of them in the header, where a change may leave something that can be read.
    places = [*range(8), *rng.integers(8, header, PLACES // 2)]
    places += rng.integers(header, len(content), PLACES - len(places)).tolist()
    bad = tmp_path / "bad.safetensors"
    refused = 0
    for place in places:
        damaged = bytearray(content)
        damaged[place] ^= int(rng.integers(1, 256))
        bad.write_bytes(bytes(damaged))
        refused += refused_or_the_same(bad, whole)
    assert refused >= PLACES - 4  # a blank for another in the header's padding changes nothing


def test_cut_off_at_random_places(kept: Path, tmp_path: Path) -> None:
    content = kept.read_bytes()
    short = tmp_path / "short.safetensors"
    places = np.random.default_rng(1).integers(0, len(content), PLACES).tolist()
    for place in [0, 7, 8, 9, len(content) - 1, *places]:
        short.write_bytes(content[:place])
        with pytest.raises(TableError, match="model-file-damaged"):
            load(short)


def parts_of(path: Path) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    with safe_open(path, framework="numpy") as stream:
        arrays = {name: stream.get_tensor(name) for name in stream.keys()}  # noqa: SIM118
        return json.loads(stream.metadata()["kiribench"]), arrays


def places_in(record: Any, at: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """The way to every key of a JSON object and, in lists, to the first entry."""
    entries = list(record.items()) if isinstance(record, dict) else list(enumerate(record))[:1]
    for key, value in entries:
        yield (*at, key)
        if isinstance(value, (dict, list)):
            yield from places_in(value, (*at, key))


def changed(record: Any, at: tuple[Any, ...], value: Any) -> Any:
    """A copy in which the place is another, or is gone where ``value`` is ``...``."""
    copy = deepcopy(record)
    inner = copy
    for key in at[:-1]:
        inner = inner[key]
    if value is ...:
        del inner[at[-1]]
    else:
        inner[at[-1]] = value
    return copy


def test_json_changed_under_the_old_checksum(kept: Path, tmp_path: Path) -> None:
    record, arrays = parts_of(kept)
    bad = tmp_path / "bad.safetensors"
    for at in places_in(record):
        for value in (..., "x", -1.5):
            text = json.dumps(changed(record, at, value))
            bad.write_bytes(encode(arrays, metadata={"kiribench": text}))
            with pytest.raises(TableError, match=r"model-file-(altered|damaged|version)"):
                load(bad)


WORKS = ("schema", "model", "settings", "seed", "strain_measure", "target", "low", "high")


def test_a_forger_who_mends_the_checksum_gets_an_error_or_the_same_model(
    kept: Path, tmp_path: Path
) -> None:
    """What a wrong program might write: keys that lack, of another kind, with other values."""
    whole = numbers(kept)
    record, arrays = parts_of(kept)
    del record["sha256"]
    bad = tmp_path / "bad.safetensors"
    refused = set()
    for at in places_in(record):
        for value in (..., None, "x", -1.5, []):
            if at[0] == "provenance" or at[:2] in (("summary", "table"), ("summary", "dropped")):
                continue
            kept_file.write(bad, changed(record, at, value), arrays)
            if value is ... and refused_or_the_same(bad, whole):
                refused.add(at)
            elif value is not ...:
                refused_or_the_same(bad, whole)
    assert {(key,) for key in WORKS} <= refused
    for name in Hyperparameters.__dataclass_fields__:
        assert ("summary", "hyperparameters", name) in refused
    for name in arrays:
        if not name.startswith("stress."):
            kept_file.write(bad, record, {n: a for n, a in arrays.items() if n != name})
            assert refused_or_the_same(bad, whole)
        kept_file.write(bad, record, arrays | {name: arrays[name][..., :-1]})
        assert refused_or_the_same(bad, whole)


def test_files_of_former_versions_are_named(kept: Path, tmp_path: Path) -> None:
    """Until version 1 of the format the kernel had no corner: what, which file, what to do."""
    record, arrays = parts_of(kept)
    del record["sha256"]
    old = tmp_path / "old.safetensors"
    kept_file.write(old, record | {"schema": "kiribench.model/1"}, arrays)
    with pytest.raises(TableError) as caught:
        load(old)
    fault = caught.value.faults[0]
    assert (fault.code, fault.file) == ("model-file-version", str(old))
    assert (fault.got, fault.expected) == ("kiribench.model/1", SCHEMA)
    without = changed(record, ("summary", "hyperparameters", "corner"), ...)
    kept_file.write(old, without, arrays)
    with pytest.raises(TableError) as caught:
        load(old)
    fault = caught.value.faults[0]
    assert (fault.code, fault.file, fault.column) == ("model-file-incomplete", str(old), "corner")
    assert "again" in fault.remedy


def test_the_checksum_is_over_names_types_and_shapes(tmp_path: Path) -> None:
    path = tmp_path / "x.safetensors"
    record = {"schema": "s/1"}
    array = np.arange(6.0)
    kept_file.write(path, record, {"x": array})
    written, _ = parts_of(path)
    for other in ({"y": array}, {"x": array.reshape(2, 3)}, {"x": array.view(np.int64)}):
        path.write_bytes(encode(other, metadata={"kiribench": json.dumps(written)}))
        with pytest.raises(TableError, match="thing-file-altered"):
            kept_file.read(path, "s/1", what="thing")
    assert written["sha256"] != hashlib.sha256(b"").hexdigest()


def test_what_json_cannot_hold_is_refused_and_leaves_nothing(tmp_path: Path) -> None:
    for wrong in (float("nan"), object()):
        with pytest.raises(UsageError, match="settings-not-plain"):
            kept_file.write(tmp_path / "x.safetensors", {"schema": "s/1", "w": wrong}, {})
    assert not list(tmp_path.iterdir())
