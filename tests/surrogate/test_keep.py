"""Models kept in a file: what comes back is what went in, and damage is noticed."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from safetensors import safe_open
from safetensors.numpy import save as encode
from stand_in import stand_in_table

from kiribench.errors import DataError, TableError, UsageError
from kiribench.schema.design_space import DesignSpace
from kiribench.surrogate import fit_table, load, save
from kiribench.surrogate.registry import model_names, spec

FloatArray = np.ndarray
MOST_BYTES = 200_000  # the limit for the paper's table, every Gaussian process


def space(levels: int, strains: FloatArray, *, own_strains: bool = False) -> DesignSpace:
    X, y = stand_in_table(levels, strains)
    if own_strains:
        X = X.copy()
        X[:, 2] *= 1.0 + 0.05 * np.sqrt(X[:, 0] / 100) * (X[:, 1] / 100)
    _, design = np.unique(X[:, :2], axis=0, return_inverse=True)
    return DesignSpace(
        file=Path(__file__),  # any file: its hash goes into the provenance
        a_percent=X[:, 0],
        b_percent=X[:, 1],
        longitudinal_strain=X[:, 2],
        poisson_ratio=y,
        design=design,
        design_names=tuple(map(str, range(design.max() + 1))),
        measure="log",
    )


SMALL = space(5, np.linspace(0.05, 0.75, 9))
QUICK = {
    "random_forest": {"n_estimators": 10},
    "gradient_boosting": {"n_estimators": 10},
    "mlp_ensemble": {"max_steps": 30},
}


@pytest.mark.parametrize("name", model_names())
def test_a_kept_model_predicts_as_it_did(name: str, tmp_path: Path) -> None:
    kept = fit_table(SMALL, name, **QUICK.get(name, {}))
    save(kept, tmp_path / "m.safetensors")
    again = load(tmp_path / "m.safetensors")
    arguments = ([12.0, 70.0, 95.0], 40.0, 0.3)
    first, second = kept.predict(*arguments), again.predict(*arguments)
    np.testing.assert_allclose(first.mean, second.mean, rtol=0, atol=1e-9)
    assert (first.sd is None) == (not spec(name).has_uncertainty)
    if first.sd is not None and second.sd is not None:
        np.testing.assert_allclose(first.sd, second.sd, rtol=0, atol=1e-9)
    assert again.measure == "log"
    assert again.summary == json.loads(json.dumps(kept.summary))
    assert first.mean.shape == (3,)


@pytest.mark.parametrize("own_strains", [False, True], ids=["grid", "resampled"])
@pytest.mark.parametrize("name", ["gp", "gp_kronecker", "svgp"])
def test_the_papers_table_fits_into_200_kb(name: str, own_strains: bool, tmp_path: Path) -> None:
    # 21 x 21 designs, 25 strains; the size does not depend on how good the fit is.
    table = space(21, np.linspace(0.05, 0.75, 25), own_strains=own_strains)
    kept = fit_table(table, name, max_evaluations=2)
    save(kept, tmp_path / "m.safetensors")
    assert (tmp_path / "m.safetensors").stat().st_size <= MOST_BYTES


def test_a_dense_gp_of_the_papers_size_fits_into_200_kb(tmp_path: Path) -> None:
    from kiribench.surrogate.state import state_of

    table = space(21, np.linspace(0.05, 0.75, 25), own_strains=True)
    arrays = state_of(fit_table(SMALL, "polynomial").estimator, table.inputs, table.poisson_ratio)
    assert sum(array.nbytes for array in arrays.values()) <= MOST_BYTES - 10_000


def test_the_same_model_gives_the_same_bytes(tmp_path: Path) -> None:
    for name in ("first", "second"):
        save(fit_table(SMALL, "gp_kronecker", max_evaluations=5), tmp_path / name)
    assert (tmp_path / "first").read_bytes() == (tmp_path / "second").read_bytes()


def test_resampled_curves_with_holes_come_back(tmp_path: Path) -> None:
    table = space(6, np.linspace(0.05, 0.75, 12), own_strains=True)
    keep = (table.design != 7) | (table.longitudinal_strain < 0.4)
    cut = DesignSpace(
        file=table.file,
        a_percent=table.a_percent[keep],
        b_percent=table.b_percent[keep],
        longitudinal_strain=table.longitudinal_strain[keep],
        poisson_ratio=table.poisson_ratio[keep],
        design=table.design[keep],
        design_names=table.design_names,
        measure="log",
    )
    kept = fit_table(cut, "gp_kronecker", max_evaluations=5)
    assert kept.summary["structure"] == "resampled"
    assert "observed" in kept.arrays
    save(kept, tmp_path / "m.safetensors")
    again = load(tmp_path / "m.safetensors")
    points = (np.linspace(5, 95, 7), 30.0, 0.2)
    np.testing.assert_allclose(
        kept.predict(*points).mean, again.predict(*points).mean, rtol=0, atol=1e-9
    )


@pytest.fixture(scope="module")
def model_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("kept") / "m.safetensors"
    save(fit_table(SMALL, "gp_kronecker", max_evaluations=3), path)
    return path


def test_the_file_holds_data_and_json_only(model_file: Path) -> None:
    with safe_open(model_file, framework="numpy") as stream:
        record = json.loads(stream.metadata()["kiribench"])
        values = stream.get_tensor("values")
    assert values.dtype == np.float64
    assert record["strain_measure"] == "log"
    assert set(record["provenance"]) >= {"kiribench", "inputs", "libraries"}
    assert b"pickle" not in model_file.read_bytes()


@pytest.mark.parametrize("kept_share", [0.0, 0.3, 0.95, 0.9999])
def test_a_truncated_file_is_refused(model_file: Path, kept_share: float, tmp_path: Path) -> None:
    content = model_file.read_bytes()
    short = tmp_path / "short.safetensors"
    short.write_bytes(content[: int(kept_share * len(content))])
    with pytest.raises(TableError) as caught:
        load(short)
    assert caught.value.code == "model-file-damaged"


@pytest.mark.parametrize("position", [0.2, 0.5, 0.99])
def test_a_flipped_bit_is_noticed(model_file: Path, position: float, tmp_path: Path) -> None:
    content = bytearray(model_file.read_bytes())
    content[int(position * len(content))] ^= 1
    bad = tmp_path / "bad.safetensors"
    bad.write_bytes(bytes(content))
    with pytest.raises(TableError) as caught:
        load(bad)
    assert caught.value.code in ("model-file-altered", "model-file-damaged")


def rewritten(model_file: Path, path: Path, change: dict[str, object]) -> Path:
    with safe_open(model_file, framework="numpy") as stream:
        record = json.loads(stream.metadata()["kiribench"])
        arrays = {name: stream.get_tensor(name) for name in stream.keys()}  # noqa: SIM118
    path.write_bytes(encode(arrays, metadata={"kiribench": json.dumps(record | change)}))
    return path


@pytest.mark.parametrize(
    ("change", "code"),
    [
        ({"strain_measure": "engineering"}, "model-file-altered"),
        ({"schema": "kiribench.model/99"}, "model-file-version"),
        ({"sha256": "0" * 64}, "model-file-altered"),
    ],
)
def test_tampered_metadata_is_noticed(
    model_file: Path, change: dict[str, object], code: str, tmp_path: Path
) -> None:
    with pytest.raises(TableError) as caught:
        load(rewritten(model_file, tmp_path / "x.safetensors", change))
    assert caught.value.code == code


def test_other_files_and_no_file_are_refused(tmp_path: Path) -> None:
    (tmp_path / "x.safetensors").write_bytes(encode({"x": np.zeros(3)}))
    (tmp_path / "y.safetensors").write_bytes(b"a,b\n1,2\n")
    for name, code in (
        ("x", "model-file-damaged"),
        ("y", "model-file-damaged"),
        ("z", "model-file-missing"),
    ):
        with pytest.raises(TableError) as caught:
            load(tmp_path / f"{name}.safetensors")
        assert caught.value.code == code


def test_a_model_that_predicts_otherwise_is_refused(tmp_path: Path) -> None:
    from dataclasses import replace

    kept = fit_table(SMALL, "polynomial")
    points, means, sds = kept.probes
    save(replace(kept, probes=(points, means + 0.01, sds)), tmp_path / "m.safetensors")
    with pytest.raises(DataError) as caught:
        load(tmp_path / "m.safetensors")
    assert caught.value.code == "model-not-reproduced"


def test_strain_measures_are_not_mixed_and_numbers_are_finite(model_file: Path) -> None:
    kept = load(model_file)
    with pytest.raises(UsageError) as caught:
        kept.predict(50, 50, 0.2, measure="engineering")
    assert caught.value.code == "strain-measure-mixed"
    with pytest.raises(UsageError):
        kept.predict(50, float("nan"), 0.2)


def test_extrapolation_is_marked(model_file: Path) -> None:
    inside = load(model_file).predict([50, 50, 2], [50, 50, 50], [0.3, 0.9, 0.3]).inside
    assert inside.tolist() == [True, False, False]


def with_stress(table: DesignSpace, stress: FloatArray) -> DesignSpace:
    from dataclasses import replace

    return replace(table, nominal_stress_mpa=stress)


@pytest.mark.parametrize("name", ["gp", "gp_kronecker", "svgp"])
def test_the_nominal_stress_is_kept_beside_poissons_ratio(name: str, tmp_path: Path) -> None:
    a, e = SMALL.a_percent / 100, SMALL.longitudinal_strain
    truth = e * 0.6 * np.exp(-2 * a)
    kept = fit_table(with_stress(SMALL, truth), name, max_evaluations=10)
    save(kept, tmp_path / "m.safetensors")
    again = load(tmp_path / "m.safetensors")
    points = (SMALL.a_percent, SMALL.b_percent, e)
    for model in (kept, again):
        stress = model.predict_stress(*points, measure="log")
        np.testing.assert_allclose(stress.mean, truth, rtol=0.02)
        assert stress.sd is not None and (stress.sd > 0).all()
    np.testing.assert_allclose(
        kept.predict_stress(*points).mean, again.predict_stress(*points).mean, rtol=1e-9
    )
    np.testing.assert_allclose(kept.predict(*points).mean, again.predict(*points).mean, atol=1e-9)
    with safe_open(tmp_path / "m.safetensors", framework="numpy") as stream:
        names = set(stream.keys())
    assert "stress.designs" not in names  # the same as those of Poisson's ratio: once


def test_the_papers_table_with_its_stress_fits_into_200_kb(tmp_path: Path) -> None:
    table = space(21, np.linspace(0.05, 0.75, 25))
    stress = table.longitudinal_strain * np.exp(-table.a_percent / 30)
    kept = fit_table(with_stress(table, stress), "gp_kronecker", max_evaluations=2)
    save(kept, tmp_path / "m.safetensors")
    assert (tmp_path / "m.safetensors").stat().st_size <= MOST_BYTES


def test_stress_that_is_partly_missing_and_models_without_it(tmp_path: Path) -> None:
    stress = SMALL.longitudinal_strain * 0.5
    stress[3] = np.nan
    kept = fit_table(with_stress(SMALL, stress), "gp_kronecker", max_evaluations=3)
    assert kept.stress is not None and kept.stress.summary["rows"] == len(stress) - 1
    save(kept, tmp_path / "m.safetensors")
    assert load(tmp_path / "m.safetensors").stress is not None
    plain = fit_table(SMALL, "gp_kronecker", max_evaluations=3)
    with pytest.raises(UsageError) as caught:
        plain.predict_stress(50, 50, 0.2)
    assert caught.value.code == "surrogate-without-stress"
    assert fit_table(with_stress(SMALL, stress), "polynomial").stress is None
