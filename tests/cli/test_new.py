"""`mjsheaf new` writes a scenario that runs as it is, and whose options are valid; it replaces nothing."""

import re
import shlex
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
import yaml

from mjsheaf import check, load_scenario, simulate
from mjsheaf.vehicles.loading import list_vehicles, load_vehicle
from tests.builders import REPOSITORY
from tests.commands import answer_of, call, is_refusal


@pytest.fixture(autouse=True)
def _here(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.chdir(tmp_path)


def test_file_is_valid_and_teaches() -> None:
    answer = answer_of("new", "search-2")
    assert answer.code == 0
    text = Path("search-2.yaml").read_text()
    assert "search-2.yaml" in answer.out
    assert not re.search(r"\{(file|name)\}", text)
    assert "mjsheaf run search-2.yaml" in text
    assert load_scenario("search-2.yaml").name == "search-2"
    options = text.replace("#: ", "")
    assert len(yaml.safe_load(options)) >= len(yaml.safe_load(text)) + 3
    assert len(load_scenario(yaml.safe_load(options)).phases) == 2
    for line in text.splitlines():
        assert len(line) <= 120


def test_a_file_named_without_its_suffix_is_proposed() -> None:
    assert call("new", "mine") == 0
    assert is_refusal(answer_of("check", "mine"), "did you mean mine.yaml?")


@pytest.mark.long
def test_it_holds_and_runs() -> None:
    assert call("new", "mine") == 0
    record = check(load_scenario("mine.yaml"), trial=False)
    assert record["ok"]
    assert record["theorem"]["applies"]
    assert record["notes"] == []
    assert call("run", "mine.yaml", "--no-video") == 0
    assert (Path("runs") / "mine-physics" / "report.html").is_file()


def test_the_commands_it_prints_can_be_pasted() -> None:
    out = answer_of("new", "a b").out
    assert "mjsheaf check 'a b.yaml', then mjsheaf run 'a b.yaml'" in out
    assert shlex.split(out)[-1] == "a b.yaml"


@pytest.mark.parametrize("name", ["mine", "mine.yaml", "mine.yml"])
def test_nothing_is_replaced(name: str) -> None:
    path = Path(name if "." in name else f"{name}.yaml")
    path.write_text("# of somebody's own")
    assert is_refusal(answer_of("new", name), "exists")
    assert path.read_text() == "# of somebody's own"
    path.unlink()
    path.symlink_to("nowhere.yaml")
    assert answer_of("new", name).code == 2
    assert sorted(Path().iterdir()) == [path]


@pytest.mark.parametrize("name", ["", ".", "..", ".yaml", "a\nb", "no/such/place", "paper", "/"])
def test_what_is_no_name_is_refused(name: str) -> None:
    assert is_refusal(answer_of("new", name))
    assert list(Path().iterdir()) == []


GYRE = REPOSITORY / "scenarios" / "double_gyre.nc"


def wind_file(path: Path) -> Path:
    """Write a wind over 24 hours on a grid of 2 km, still over land in its west."""
    longitude, latitude = np.linspace(7.0, 7.5, 21), np.linspace(43.0, 43.4, 17)
    shape = 5, len(latitude), len(longitude)
    values = np.full(shape, 3.0)
    values[:, :, :8] = np.nan
    attrs = {"units": "m s-1", "standard_name": "eastward_wind"}
    data = xr.Dataset(
        {
            "east": (("time", "latitude", "longitude"), values, attrs),
            "north": (("time", "latitude", "longitude"), 0.5 * values, attrs | {"standard_name": "northward_wind"}),
        },
        {
            "time": np.datetime64("2026-03-01T06:00", "ns") + np.arange(5) * np.timedelta64(6, "h"),
            "latitude": latitude,
            "longitude": longitude,
        },
    )
    data.to_netcdf(path, engine="h5netcdf")
    return path


def test_a_current_out_of_a_file(tmp_path: Path) -> None:
    (tmp_path / "data").mkdir()
    shutil.copy(GYRE, tmp_path / "data" / "a gyre.nc")
    answer = answer_of("new", "mine", "--from-netcdf", "data/a gyre.nc")
    assert answer.code == 0, answer.err
    scenario = load_scenario("mine.yaml")
    water: Any = scenario.flow.water
    assert water.kind == "gridded"
    assert water.start == "2026-05-01T00:00:00"
    assert Path(water.path).name == "a gyre.nc"
    run = simulate(load_scenario("mine.yaml", {"time.end": 2}), "ideal")
    assert run.status == "finished"
    flow = run.agent_flow.values
    assert np.isfinite(flow[..., :2]).all()
    assert np.ptp(flow[:, 2, 0]) > 0.0


def test_a_wind_out_of_a_file_is_met_away_from_gaps(tmp_path: Path) -> None:
    wind_file(tmp_path / "wind.nc")
    assert call("new", "sub.yml", "--from-netcdf", str(tmp_path / "wind.nc")) == 0
    scenario = load_scenario("sub.yml")
    air: Any = scenario.flow.air
    latitude, longitude = air.origin
    assert longitude > 7.0 + 8 * 0.025 + 0.05
    assert 43.1 < latitude < 43.3
    assert (air.kind, air.start) == ("gridded", "2026-03-01T06:00:00")
    run = simulate(load_scenario("sub.yml", {"time.end": 1}), "ideal")
    np.testing.assert_allclose(run.agent_flow.values[0, 0], [3.0, 1.5, 0.0], atol=0.1)


@pytest.mark.parametrize(
    ("content", "words"),
    [(None, "there is no file"), (b"CDF", "no netCDF file"), ({}, "no velocities"), ({"clear": 1.0}, "expected 40 m")],
)
def test_files_without_a_flow_are_refused(content: object, words: str, tmp_path: Path) -> None:
    path = tmp_path / "x.nc"
    if isinstance(content, bytes):
        path.write_bytes(content)
    elif content == {}:
        xr.Dataset({"salinity": ("x", np.zeros(3))}).to_netcdf(path, engine="h5netcdf")
    elif content:
        data = xr.open_dataset(GYRE).load()
        data.isel({name: slice(0, 4) for name in data.sizes if name != "time"}).to_netcdf(path, engine="h5netcdf")
    assert is_refusal(answer_of("new", "mine", "--from-netcdf", "x.nc"), words, "--from-netcdf")
    assert not Path("mine.yaml").exists()


OTTER = list_vehicles()["otter"].with_suffix(".xml")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["sub/mine", "--from-netcdf", "wind.nc"], "outside the directory of sub/mine.yaml"),
        (["otter", "--vehicle", "model.xml"], "otter: is the name of an included vehicle; expected another name"),
        (["mine", "--vehicle", "none.xml"], "none.xml"),
        (["mine", "--vehicle", "text.xml"], "not XML"),
        (["mine", "--vehicle", "../above.xml"], "lies outside the directory of mine.yaml"),
        (["mine", "--vehicle", "model.xml", "--from-netcdf", "wind.nc"], "expected one of them"),
    ],
)
def test_what_a_file_cannot_be_made_of_is_refused(arguments: list[str], words: str, tmp_path: Path) -> None:
    wind_file(tmp_path / "wind.nc")
    shutil.copy(OTTER, "model.xml")
    Path("text.xml").write_text("hello")
    Path("sub").mkdir()
    assert is_refusal(answer_of("new", *arguments), words)
    assert not list(Path().rglob("*.yaml"))


# -- descriptions of vehicles --------------------------------------------------------------------------------------

SHIPPED = list_vehicles()


def filled(text: str, fields: dict[str, Any]) -> dict[str, Any]:
    """A proposed description with numbers of another in the place of each TODO."""
    found: dict[str, Any] = yaml.safe_load(text)

    def fill(value: Any, known: Any) -> Any:
        if isinstance(value, dict):
            return {key: fill(inner, (known or {}).get(key)) for key, inner in value.items()}
        if isinstance(value, list):
            return [fill(inner, (known or [1.0] * len(value))[k]) for k, inner in enumerate(value)]
        return (known or 1.0) if value == "TODO" else value

    return {key: fill(value, fields.get(key)) for key, value in found.items()}


@pytest.mark.parametrize("name", SHIPPED)
def test_a_description_says_what_the_model_says(name: str) -> None:
    """Filled with the numbers of the shipped one, it has the same vehicle, but for what MJCF cannot say."""
    shutil.copy(SHIPPED[name].with_suffix(".xml"), "model.xml")
    answer = answer_of("new", "mine", "--vehicle", "model.xml")
    assert answer.code == 0, answer.err
    assert "replace each TODO, then mjsheaf list --vehicles mine.yaml" in " ".join(answer.out.split())
    text, shipped = Path("mine.yaml").read_text(), yaml.safe_load(SHIPPED[name].read_text())
    found = filled(text, shipped)
    assert found["mjcf"] == "model.xml"
    assert found["domain"] == shipped["domain"]
    assert found.get("drifts", False) == shipped.get("drifts", False)
    vehicle = load_vehicle(name)
    assert f"{vehicle.mass:.4g} kg" in text
    for channel in vehicle.channels if not shipped.get("actuators") else []:
        assert f"# {channel.name}: {channel.low:g} to {channel.high:g} N" in text
    if shipped.get("actuators"):  # thrusters that turn
        return
    assert set(found.get("steering", {})) == set(shipped.get("steering", {}))
    Path("mine.yaml").write_text(yaml.safe_dump(found))
    own = load_vehicle("mine.yaml")
    assert (own.mass, own.size, own.lag) == (vehicle.mass, vehicle.size, vehicle.lag)
    np.testing.assert_array_equal(own.W, vehicle.W)
    np.testing.assert_array_equal(own.inertia, vehicle.inertia)


@pytest.mark.parametrize("up", [-0.05, 0.05])
def test_what_cannot_lift_its_weight_does_not_fly(up: float) -> None:
    text = OTTER.read_text()
    tilted = text.replace('zaxis="1 0 0"', f'zaxis="1 0 {up}"')
    assert tilted != text
    Path("model.xml").write_text(tilted)
    assert call("new", "mine", "--vehicle", "model.xml") == 0
    assert "domain: surface  # proposed" in Path("mine.yaml").read_text()


def test_a_description_names_what_is_missing() -> None:
    shutil.copy(OTTER, "model.xml")
    assert call("new", "harbour", "--vehicle", "model.xml") == 0  # a scenario's name, and no vehicle's
    assert call("new", "mine", "--vehicle", "model.xml") == 0
    answer = answer_of("list", "--vehicles", "mine.yaml")
    assert answer.code == 2
    for field in ("drag.linear.0", "drag.angular.2", "hydrostatics.heave", "hydrostatics.pitch"):
        assert f"mine.yaml: {field}: expected a number, not 'TODO'" in answer.err
