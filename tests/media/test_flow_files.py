"""Flow files by CF: a file for each attribute and kind of axis, read with the right value or refused in one line."""

import json
import os
import re
import warnings
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import cftime  # type: ignore[import-untyped]
import numpy as np
import pyproj
import pytest
import xarray as xr
from cf_xarray.criteria import coordinate_criteria

import mjsheaf
from mjsheaf.errors import InputError
from mjsheaf.media.flow_files import propose, read_flow
from mjsheaf.media.gridded import GriddedFlow, Reading
from mjsheaf.scenario import Scenario
from mjsheaf.scenario.load import load_scenario, scenario_from_mapping
from tests.builders import ONE_BOAT, pursuit

LATITUDE, LONGITUDE = 43.0, 7.0
U, V = 0.3, -0.1
HOURS = "hours since 2026-05-01"


@dataclass
class File:
    """Contents of a file: dimensions, values and attributes of each variable, as they are written."""

    variables: dict[str, tuple[tuple[str, ...], Any, dict[str, Any]]] = field(default_factory=dict)

    def set(self, name: str, values: Any = None, dims: tuple[str, ...] | None = None, **attrs: Any) -> "File":
        """Set values, dimensions or attributes of a variable, which may be new; None removes an attribute."""
        old = self.variables.get(name, ((), None, {}))
        kept = {k: v for k, v in {**old[2], **attrs}.items() if v is not None}
        self.variables[name] = (old[0] if dims is None else dims, old[1] if values is None else values, kept)
        return self

    def flow(self, **attrs: Any) -> "File":
        return self.set("uo", **attrs).set("vo", **attrs)

    def values(self, change: Callable[[Any], Any], dims: tuple[str, ...] | None = None) -> "File":
        for name in ("uo", "vo"):
            self.set(name, change(self.variables[name][1]), dims)
        return self

    def drop(self, *names: str) -> "File":
        for name in names:
            del self.variables[name]
        return self

    def rename(self, **names: str) -> "File":
        """Rename variables and their dimensions."""
        self.variables = {
            names.get(name, name): (tuple(names.get(d, d) for d in dims), values, attrs)
            for name, (dims, values, attrs) in self.variables.items()
        }
        return self

    def write(self, path: Path) -> Path:
        """Write the file as it is, without encoding."""
        data = xr.Dataset({name: xr.Variable(*v) for name, v in self.variables.items()})
        for name, (_, _, attrs) in self.variables.items():
            if "_FillValue" not in attrs:  # xarray adds NaN else
                data[name].encoding["_FillValue"] = None
        data.to_netcdf(path, engine="h5netcdf")
        return path


def current() -> File:
    dims = ("time", "lat", "lon")
    shape = (3, 4, 5)
    file = File()
    file.set("time", np.arange(3.0), ("time",), standard_name="time", units=HOURS)
    file.set("lat", LATITUDE + np.linspace(-0.01, 0.01, 4), ("lat",), standard_name="latitude", units="degrees_north")
    file.set("lon", LONGITUDE + np.linspace(-0.01, 0.01, 5), ("lon",), standard_name="longitude", units="degrees_east")
    file.set("uo", np.full(shape, U), dims, standard_name="eastward_sea_water_velocity", units="m s-1")
    file.set("vo", np.full(shape, V), dims, standard_name="northward_sea_water_velocity", units="m s-1")
    return file


def wind() -> File:
    file = current()
    return file.set("uo", standard_name="eastward_wind").set("vo", standard_name="northward_wind")


def read(path: Path, medium: Any = "water", **fields: Any) -> Reading:
    """Read a file about its middle; no warning of a library may be seen."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        return GriddedFlow(**{"kind": "gridded", "path": str(path), "origin": [LATITUDE, LONGITUDE], **fields}).read(
            medium
        )


@pytest.fixture
def place(tmp_path: Path) -> Path:
    return tmp_path / "flow.nc"


def decide(file: File, path: Path, wanted: Any, medium: Any = "water", **fields: Any) -> None:
    """Assert that a file is read with these values of (u, v), or refused in one line with these words."""
    file.write(path)
    if isinstance(wanted, str):
        with pytest.raises(InputError, match=wanted) as error:
            read(path, medium, **fields)
        assert len(str(error.value).splitlines()) == 1
        assert "flow.nc" in str(error.value)
        return
    grid = read(path, medium, **fields).grid
    np.testing.assert_allclose(grid.velocity[..., :2], np.broadcast_to(wanted, grid.velocity[..., :2].shape), rtol=1e-6)


# -- attributes of CF's appendix A ---------------------------------------------------------------------------------


def packed(file: File, **attrs: Any) -> File:
    """Pack the values: 0.001 m/s for each count, from 0.1 m/s."""
    file.values(lambda w: np.rint((w - 0.1) / 0.001).astype(np.int16))
    return file.flow(scale_factor=0.001, add_offset=0.1, **attrs)


def level(file: File, **attrs: Any) -> File:
    """Give the velocities a third axis with two places, of which the first has the known flow."""
    values = attrs.pop("values", np.array([1.0, 2.0]))
    attrs.setdefault("standard_name", None)
    file.set("level", values, ("level",), **attrs)
    return file.values(lambda w: np.stack([w, 2.0 * w], axis=1), ("time", "level", "lat", "lon"))


def as_list(file: File, **attrs: Any) -> File:
    """Put all places in a list, as meshes, trajectories and compressed grids do, whose axis may have attributes."""
    file.set("lat", LATITUDE + np.linspace(-0.01, 0.01, 5), ("node",)).set("lon", dims=("node",))
    if attrs:
        file.set("node", np.arange(5), ("node",), **attrs)
    return file.values(lambda w: w[:, 0, :], ("time", "node"))


UNCHANGED = (U, V)
Change = Callable[[File], File]
ATTRIBUTES: dict[str, Change | tuple[Change, Any]] = {
    "all that nothing reads": lambda f: f.set("domain", np.int32(0), (), dimensions="time lat lon").flow(
        actual_range=[-1.0, 1.0],
        ancillary_variables="quality",
        cell_measures="area: areacello",
        comment="wind",
        computed_standard_name="altitude",
        external_variables="areacello",
        geometry="lines",
        quantization="quantization_info",
        title="waves",
        units_metadata="temperature: on_scale",
    ),
    "add_offset": lambda f: f.values(lambda w: w - 0.25).flow(add_offset=0.25),
    "axis": lambda f: f.rename(lat="j", lon="i").set("j", axis="Y", standard_name=None).set("i", axis="X"),
    "bounds": lambda f: f.set("lat", bounds="lat_bnds").set("lat_bnds", np.zeros((4, 2)), ("lat", "nv")),
    "calendar": lambda f: f.set("time", calendar="360_day"),
    "calendar of users": (lambda f: f.set("time", calendar="martian"), "time has no dates.*martian"),
    "cell_methods": lambda f: f.flow(cell_methods="time: mean (interval: 1 hour comment: sampled) area: mean"),
    "cell_methods over several axes": lambda f: f.flow(cell_methods="time: lat: lon: mean"),
    "cell_methods of a variance": (lambda f: f.flow(cell_methods="time: variance"), "uo \\(variance\\)"),
    "cell_methods of a maximum": (lambda f: f.flow(cell_methods="area: mean time: Maximum"), "uo \\(maximum\\)"),
    "cf_role": (lambda f: as_list(f, cf_role="trajectory_id"), "a list \\(node\\)"),
    "climatology": (lambda f: f.set("time", climatology="climatology_bounds"), "climatology"),
    "compress": (
        lambda f: (
            f.drop("lat", "lon")
            .values(lambda w: w[:, 0, :], ("time", "land"))
            .set("land", np.arange(5), ("land",), compress="lat lon")
        ),
        "uo: has no latitude|uo: has no longitude",
    ),
    "coordinate_interpolation": (
        lambda f: f.rename(lat="tie_lat", lon="tie_lon").flow(coordinate_interpolation="lat: lon: bl").drop("tie_lat"),
        "uo: has no latitude",
    ),
    "coordinates": lambda f: (
        f.rename(lat="north", lon="east")
        .flow(coordinates="north east")
        .values(lambda w: w, ("time", "j", "i"))
        .set("north", dims=("j",))
        .set("east", dims=("i",))
    ),
    "_FillValue": (lambda f: hole(f, -999.0).flow(_FillValue=-999.0), "hole"),
    "flag_masks": (lambda f: f.values(lambda w: w.astype(np.int16)).flow(flag_masks=[1]), "expected numbers"),
    "flag_meanings": (lambda f: f.values(lambda w: w.astype(np.int16)).flow(flag_meanings="a b"), "expected numbers"),
    "flag_values": (lambda f: f.values(lambda w: w.astype(np.int16)).flow(flag_values=[1, 2]), "expected numbers"),
    "formula_terms": (
        lambda f: level(f, standard_name="ocean_sigma_coordinate", formula_terms="sigma: level eta: zeta depth: h"),
        "uo: has an axis level.*`select`: 1, 2",
    ),
    "grid_mapping": lambda f: f.flow(grid_mapping="crs").set("crs", 0, (), grid_mapping_name="latitude_longitude"),
    "grid_mapping that is missing": lambda f: f.flow(grid_mapping="crs"),
    "instance_dimension": (lambda f: as_list(f, instance_dimension="t"), "a list"),
    "leap_month": (lambda f: f.set("time", calendar="none", leap_month=2, leap_year=1600), "time has no dates"),
    "mesh": (lambda f: as_list(f).flow(mesh="mesh", location="node"), "a list \\(node\\)"),
    "missing_value": (lambda f: hole(f, -999.0).flow(missing_value=-999.0), "hole"),
    "missing_value of several": (lambda f: hole(f, -999.0).flow(missing_value=[-1.0, -999.0]), "hole"),
    "_FillValue and missing_value": (lambda f: hole(f, -999.0).flow(_FillValue=-1.0, missing_value=-999.0), "hole"),
    "the fill value of netCDF": (lambda f: hole(f, 9.969209968386869e36), "hole"),
    "the fill value of netCDF, packed": (lambda f: hole(packed(f), -32767), "hole"),
    "a number for nothing that no attribute names": (lambda f: hole(f, -9999.0), "uo: is -9999 m/s at 2026-05-01"),
    "node_count": lambda f: f.flow(node_count="n"),
    "positive": lambda f: level(f, values=np.array([-1.0, -2.0]), units="m", positive="up"),
    "positive against the medium": (lambda f: level(f, units="m", positive="up"), "level goes from 1 to 2 m up"),
    "sample_dimension": (lambda f: as_list(f, sample_dimension="obs"), "a list"),
    "scale_factor": packed,
    "standard_error_multiplier": (
        lambda f: f.flow(standard_name="eastward_sea_water_velocity standard_error", standard_error_multiplier=2.0),
        "has no velocities",
    ),
    "standard_name that is a number": lambda f: f.flow(standard_name=5),
    "units": lambda f: f.values(lambda w: 100.0 * w).flow(units="cm s-1"),
    "units of one": (lambda f: f.set("vo", units="knots"), (U, V * 1852.0 / 3600.0)),
    "units written as ms-1": lambda f: f.flow(units="ms-1"),
    "units in capitals": lambda f: f.flow(units="M/S"),
    "units of no speed": (lambda f: f.set("vo", units="Pa"), "vo: the unit is 'Pa'; expected m s-1"),
    "units of a number": (lambda f: f.set("vo", units=5), "vo: the unit is '5'; expected m s-1"),
    "units missing": (lambda f: f.set("vo", units=None), "vo: has no units.*ncatted"),
    "valid_min": (lambda f: hole(f, -3.0).flow(valid_min=-2.0), "hole"),
    "valid_max": (lambda f: hole(f, 3.0).flow(valid_max=2.0), "hole"),
    "valid_range": (lambda f: hole(f, 3.0).flow(valid_range=[-2.0, 2.0]), "hole"),
    "valid_range of text": (lambda f: f.flow(valid_range="-2 2"), "uo: has a valid_min, .* of -2 2; expected numbers"),
    "valid_range of packed values": (
        lambda f: hole(packed(f), 3000).flow(valid_range=np.array([-2000, 2000], "i2")),
        "hole",
    ),
    "valid_range of unpacked values": (lambda f: hole(packed(f), 3000).flow(valid_range=[-2.0, 2.0]), "hole"),
    "missing_value that is text": (lambda f: hole(f, -9.0).flow(missing_value="-9."), "hole"),
    "missing_value that is no number": (lambda f: f.flow(missing_value="none"), "cannot be read"),
    "valid_min that is no number": (lambda f: f.flow(valid_min="n/a"), "expected numbers"),
    "scale_factor that is text": (lambda f: f.flow(scale_factor="0.5"), "cannot be read"),
    "_Unsigned in capitals": (lambda f: of_bytes(f, _Unsigned="True"), (0.2, 0.2)),
    "_Unsigned": (lambda f: of_bytes(f, _Unsigned="true", valid_range=np.array([0, -2], np.int8)), (0.2, 0.2)),
}


def of_bytes(file: File, **attrs: Any) -> File:
    """Pack the values in bytes, which are 200 without their sign: 0.001 m/s for each count."""
    return file.values(lambda w: np.full(w.shape, -56, np.int8)).flow(scale_factor=0.001, **attrs)


def hole(file: File, value: Any) -> File:
    """Put a value that stands for missing data at the first node."""

    def at_first(w: Any) -> Any:
        w = w.copy()
        w[:, 0, 0] = value
        return w

    return file.values(at_first)


@pytest.mark.parametrize("name", ATTRIBUTES)
def test_every_attribute_of_cf_is_read_refused_or_without_effect(name: str, place: Path) -> None:
    case = ATTRIBUTES[name]
    edit, wanted = case if isinstance(case, tuple) else (case, UNCHANGED)
    if wanted != "hole":
        decide(edit(current()), place, wanted)
        return
    edit(current()).write(place)
    velocity = read(place).grid.velocity[..., :2]
    assert np.isnan(velocity[:, 0, 0]).all()
    velocity[:, 0, 0] = UNCHANGED
    np.testing.assert_allclose(velocity, np.broadcast_to(UNCHANGED, velocity.shape), rtol=1e-6)


def test_packed_values_are_those_of_xarray_to_the_bit(place: Path) -> None:
    rng = np.random.default_rng(0)
    file = packed(current(), _FillValue=np.int16(-32768))
    file.values(lambda w: rng.integers(-1000, 1000, w.shape).astype(np.int16)).write(place)
    velocity = read(place).grid.velocity
    with xr.open_dataset(place, engine="h5netcdf") as data:
        assert np.array_equal(velocity[..., 0], data["uo"].values.astype(np.float64))
        assert np.array_equal(velocity[..., 1], data["vo"].values.astype(np.float64))


# -- variables -----------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_u_and_v_are_of_one_family_that_fits_the_section(place: Path) -> None:
    file = current()
    for name, standard, value in (("a", "eastward_wind", 8.0), ("z", "northward_wind", 6.0)):
        file.set(name, np.full((3, 4, 5), value), ("time", "lat", "lon"), standard_name=standard, units="m s-1")
    decide(file, place, UNCHANGED)
    decide(file, place, (8.0, 6.0), "air")
    decide(file, place, r"has several flows: \[uo, vo\], \[a, z\]; expected one of them in `variables`", None)
    decide(file, place, (8.0, 6.0), None, variables=["a", "z"])
    decide(file, place, "variables: a is eastward_wind; expected it in flow.air", variables=["a", "z"])
    decide(file, place, "variables: uo and z are of different flows", None, variables=["uo", "z"])
    decide(file, place, "variables: vo is northward_sea_water_velocity; expected u, v", variables=["vo", "uo"])
    decide(file, place, "variables: there is no 'u0'; expected one of uo, vo, a, z", variables=["u0", "vo"])
    decide(wind(), place, r"has a wind, \[uo, vo\], which fits flow.air, but no flow of water")
    decide(current(), place, r"has a current, \[uo, vo\], which fits flow.water, but no flow of air", "air")


@pytest.mark.parametrize(
    ("east", "medium"),
    [
        ("surface_eastward_sea_water_velocity", "water"),
        ("barotropic_eastward_sea_water_velocity", "water"),
        ("surface_geostrophic_eastward_sea_water_velocity", "water"),
        ("sea_water_x_velocity", "water"),
        ("x_sea_water_velocity", "water"),
        ("x_wind", "air"),
    ],
)
def test_families_of_velocities(east: str, medium: str, place: Path) -> None:
    north = east.replace("eastward", "northward").replace("x_", "y_")
    file = current().set("uo", standard_name=east).set("vo", standard_name=north)
    decide(file, place, UNCHANGED, medium)
    decide(file, place, "but no flow of", "air" if medium == "water" else "water")
    decide(file.set("vo", standard_name="sea_ice_y_velocity"), place, "has no velocities", medium)


@pytest.mark.parametrize(
    "standard", ["eastward_sea_ice_velocity", "eastward_sea_water_velocity_due_to_tides", "nonsense"]
)
def test_what_is_not_known_as_the_flow_is_chosen_by_its_name_alone(standard: str, place: Path) -> None:
    file = current().set("uo", standard_name=standard)
    file.set("vo", standard_name=standard.replace("eastward", "northward"))
    decide(file, place, "has no velocities.*expected two of uo, vo in `variables`")
    decide(file, place, UNCHANGED, variables=["uo", "vo"])


def test_names_count_where_no_standard_name_does(place: Path) -> None:
    decide(current().flow(standard_name=None).rename(uo="U", vo="V"), place, UNCHANGED)
    decide(current().flow(standard_name=None).rename(uo="u10", vo="v10"), place, "fits flow.air, but no flow of water")
    decide(current().flow(standard_name=None, long_name="10 m wind").rename(uo="u", vo="v"), place, "fits flow.air")
    file = current().flow(standard_name=None).rename(uo="u10", vo="v10")
    for name, value in (("u100", 9.0), ("v100", 3.0)):
        file.set(name, np.full((3, 4, 5), value), ("time", "lat", "lon"), units="m s-1")
    decide(file, place, r"several flows: \[u10, v10\], \[u100, v100\]", "air")
    decide(file, place, (9.0, 3.0), "air", variables=["u100", "v100"])


def test_the_third_component_is_upward_and_may_be_left_out(place: Path) -> None:
    upward = {"standard_name": "upward_air_velocity", "units": "m/s"}
    pressure = {"standard_name": "lagrangian_tendency_of_air_pressure", "units": "Pa s-1"}
    for attrs, w in ((upward, 0.7), (upward | {"cell_methods": "time: maximum"}, 0.0), (pressure, 0.0)):
        wind().set("w", np.full((3, 4, 5), 0.7), ("time", "lat", "lon"), **attrs).write(place)
        assert (read(place, "air").grid.velocity[..., 2] == w).all()
        assert (read(place, "air", variables=["uo", "vo"]).grid.velocity[..., 2] == 0.0).all()


@pytest.mark.parametrize(("medium", "speed"), [("water", 20.0), ("air", 150.0)])
def test_speeds_that_no_medium_has_are_refused_with_place_and_time(medium: str, speed: float, place: Path) -> None:
    for value in (1.01 * speed, -1.01 * speed, np.inf, 1e200):
        file = current() if medium == "water" else wind()
        values = np.full((3, 4, 5), U)
        values[1, 2, 3] = value
        words = f"uo: is {re.escape(f'{value:.4g}')} m/s at 2026-05-01.01:00:00, lat 43.0033, lon 7.005"
        decide(file.set("uo", values), place, words, medium)
    decide(file.set("uo", np.full((3, 4, 5), 0.99 * speed)), place, (0.99 * speed, V), medium)


# -- axes ----------------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_longitudes_and_latitudes_by_their_units(place: Path) -> None:
    for name in ("lat", "lon"):
        plain = current().set(name, standard_name=None)
        decide(plain, place, UNCHANGED)
        decide(plain.set(name, units=None), place, UNCHANGED)
        angle = current().set(name, np.radians(current().variables[name][1]), units="radian")
        decide(angle, place, UNCHANGED)
        assert read(place).grid.x == pytest.approx(read(current().write(place)).grid.x, abs=1e-6)
        decide(current().set(name, units="m"), place, f"uo: {name}: the unit is 'm'; expected degree")
        values = current().variables[name][1].copy()
        values[1] = np.nan
        decide(current().set(name, values), place, f"uo: {name}: has missing values")
        values[1] = values[0]
        decide(current().set(name, values), place, f"uo: {name} has . values, or one of them twice")
    decide(current().set("lat", np.array([0.0, 30.0, 60.0, 91.0])), place, "lat has values from 0 to 91")
    decide(current().values(lambda w: w[..., :1]).set("lon", np.array([7.0])), place, "lon has 1 values")
    decide(current().rename(lat="y", lon="x").set("x", standard_name=None, units=None), place, "uo: has no longitude")


def test_places_in_any_order_and_over_greenwich(place: Path) -> None:
    rng = np.random.default_rng(1)
    lon = np.array([359.5, 0.5, 359.0, 0.0, 1.0])
    lat = np.array([0.25, -0.25, 0.75, 0.5])
    u = rng.uniform(-1.0, 1.0, (3, 4, 5))
    current().set("lon", lon).set("lat", lat).set("uo", u).write(place)
    grid = read(place, origin=[0.0, 0.0]).grid
    columns, rows = [2, 0, 3, 1, 4], [1, 0, 3, 2]
    assert np.array_equal(grid.velocity[..., 0], u[:, rows][:, :, columns])
    assert grid.x == pytest.approx(np.radians([-1.0, -0.5, 0.0, 0.5, 1.0]) * 6_371_000.0)


def test_longitudes_on_both_sides_of_a_gap_are_no_neighbours(place: Path) -> None:
    def around(lon: Any) -> File:
        file = current().set("lon", np.asarray(lon, np.float64))
        return file.values(lambda w: np.full((3, 4, len(lon)), w[0, 0, 0]))

    lat, words = LATITUDE, "lon extends further than half a turn"
    decide(around(np.arange(20, 341)), place, words, origin=[lat, 0.0])
    decide(around(np.arange(0, 201)), place, words, origin=[lat, 0.0])
    decide(around(np.arange(0, 201)), place, UNCHANGED, origin=[lat, 100.0])
    decide(around(np.arange(0, 360)), place, UNCHANGED, origin=[lat, 7.0])
    decide(around([178.0, 179.0, -180.0, -179.0]), place, UNCHANGED, origin=[lat, 180.0])
    decide(around([1e30, 2e30]), place, "lon has values from 1e[+]30")


def test_damaged_files_are_refused_and_nothing_else_is_said(place: Path, capfd: pytest.CaptureFixture[str]) -> None:
    current().write(place)
    whole = place.read_bytes()
    rng = np.random.default_rng(0)
    for k in range(40):
        data = bytearray(whole[: int(rng.integers(len(whole)))] if k < 10 else whole)
        for at in rng.integers(0, min(len(data), 800), 3):
            data[at] = int(rng.integers(256))
        place.write_bytes(data)
        read_flow.cache_clear()
        with suppress(InputError):
            read(place)
    assert capfd.readouterr().err == ""


MAPPINGS: dict[str, dict[str, Any]] = {
    "mercator": {"standard_parallel": 0.0, "longitude_of_projection_origin": 0.0},
    "polar_stereographic": {
        "latitude_of_projection_origin": 90.0,
        "straight_vertical_longitude_from_pole": 58.0,
        "standard_parallel": 60.0,
    },
    "lambert_conformal_conic": {
        "standard_parallel": [50.0, 63.0],
        "longitude_of_central_meridian": -25.0,
        "latitude_of_projection_origin": 55.0,
    },
    "rotated_latitude_longitude": {"grid_north_pole_latitude": 39.25, "grid_north_pole_longitude": -162.0},
}


def projected(mapping: str, unit: str, along: str) -> tuple[File, Any, Any]:
    """Return a file of 10 m/s east and 4 m/s north, which grow with latitude and longitude, and both of its nodes."""
    attrs = {"grid_mapping_name": mapping, **MAPPINGS[mapping]}
    crs = pyproj.CRS.from_cf(attrs)
    to_places = pyproj.Transformer.from_crs(crs, crs.source_crs, always_xy=True)
    x0, y0 = to_places.transform(5.0, 62.0, direction="INVERSE")
    step = 0.01 if crs.is_geographic else 1000.0
    x, y = x0 + step * np.arange(-4.0, 6.0), y0 + step * np.arange(5.0, -5.0, -1.0)
    lon, lat = to_places.transform(*np.meshgrid(x, y))
    east, north = 10.0 + 100.0 * (lat - 62.0), 4.0 + 100.0 * (lon - 5.0)
    if along == "grid":  # by central differences of the places, which are independent of the reader's; y falls
        down, right = np.moveaxis(np.array([np.gradient(values, edge_order=2) for values in (lon, lat)]), 1, 0)
        axes = np.array([right, -down]) * np.array([np.cos(np.radians(lat)), np.ones_like(lat)])
        matrix = np.moveaxis(axes / np.linalg.norm(axes, axis=1, keepdims=True), (0, 1), (-1, -2))
        east, north = np.moveaxis(np.linalg.solve(matrix, np.stack([east, north], -1)[..., None])[..., 0], -1, 0)
    names = ("x_wind", "y_wind") if along == "grid" else ("eastward_wind", "northward_wind")
    size = 1000.0 if unit == "km" else 1.0
    kind = "grid_longitude" if crs.is_geographic else "projection_x_coordinate"
    file = File()
    file.set("x", x / size, ("x",), standard_name=kind, units=unit, axis="X")
    kind = "grid_latitude" if crs.is_geographic else "projection_y_coordinate"
    file.set("y", y / size, ("y",), standard_name=kind, units=unit, axis="Y")
    file.set("crs", 0, (), **attrs)
    for name, standard, values in (("u", names[0], east), ("v", names[1], north)):
        file.set(name, values, ("y", "x"), standard_name=standard, units="m s-1", grid_mapping="crs")
    return file, lat, lon


@pytest.mark.slow
@pytest.mark.parametrize("along", ["earth", "grid"])
@pytest.mark.parametrize("mapping", MAPPINGS)
def test_projected_grids_lie_in_the_plane_with_x_east(mapping: str, along: str, place: Path) -> None:
    rotated = mapping == "rotated_latitude_longitude"
    file, lat, lon = projected(mapping, "degrees" if rotated else "km", along)
    file.write(place)
    grid = read(place, "air", origin=[62.0, 5.0]).grid
    metres = np.radians(1.0) * 6_371_000.0
    x, y = (lon - 5.0) * metres * np.cos(np.radians(62.0)), (lat - 62.0) * metres
    found = np.einsum("ij,jyx->iyx", grid.turn, np.stack([x, y])[:, ::-1])
    X, Y = np.meshgrid(grid.x, grid.y)
    assert np.abs(found[0] - X).max() < 10.0  # second order: 5 km of a plane
    assert np.abs(found[1] - Y).max() < 10.0
    origin = np.argwhere((np.abs(X) < 1e-3) & (np.abs(Y) < 1e-3))[0]
    assert grid.velocity[0, origin[0], origin[1], :2] == pytest.approx([10.0, 4.0], abs=1e-6)
    wanted = np.stack([10.0 + 100.0 * (lat - 62.0), 4.0 + 100.0 * (lon - 5.0)], -1)[::-1]
    assert grid.velocity[0, ..., :2] == pytest.approx(wanted, abs=0.05)  # meridians converge by 2 mrad


def test_the_run_meets_the_wind_of_a_turned_grid(place: Path) -> None:
    file, _, _ = projected("polar_stereographic", "m", "grid")
    file.write(place)
    air = {"kind": "gridded", "path": str(place), "origin": [62.0, 5.0]}
    scenario = pursuit([0, 0, 10], [5, 5, 10], time={"end": 1.0}, flow={"air": air})
    degree = np.radians(1.0) * 6_371_000.0
    found = mjsheaf.medium(scenario).velocity("A", [0.0, 0.5], [[0.0, 0.0, 10.0], [1500.0, 700.0, 10.0]])
    assert found[0, :2] == pytest.approx([10.0, 4.0], abs=1e-6)
    further = [10.0 + 100.0 * 700.0 / degree, 4.0 + 100.0 * 1500.0 / degree / np.cos(np.radians(62.0))]
    assert found[1, :2] == pytest.approx(further, abs=0.01)
    slopes = scenario.system.moving_bounds.slope
    assert slopes[0] == pytest.approx(100.0 / degree / np.cos(np.radians(62.0)), rel=0.05)
    with pytest.raises(InputError, match=r"left the file .* along the axes of its grid"):
        mjsheaf.medium(scenario).velocity("A", [0.0], [9e4, 0.0, 10.0])


def test_projections_that_are_not_understood_are_refused(place: Path) -> None:
    file, lat, lon = projected("mercator", "m", "grid")
    file.set("crs", grid_mapping_name="orange_peel")
    decide(file, place, r"u: its axes x and y \(m\) are not degrees", "air", origin=[62.0, 5.0])
    file, lat, lon = projected("mercator", "m", "grid")
    for name in ("u", "v"):
        file.set(name, grid_mapping=None)
    decide(file, place, r"u: its axes x and y \(m\) are not degrees", "air", origin=[62.0, 5.0])
    file, lat, lon = projected("polar_stereographic", "m", "grid")
    file.set("lat", lat + 0.1, ("y", "x"), standard_name="latitude", units="degrees_north")
    file.set("lon", lon, ("y", "x"), standard_name="longitude", units="degrees_east")
    decide(file, place, "it misses lat and lon by 1.11e", "air", origin=[62.0, 5.0])
    file.set("lat", lat).write(place)
    assert read(place, "air", origin=[62.0, 5.0]).grid.velocity.shape == (1, 10, 10, 3)
    for name in ("u", "v"):
        file.set(name, standard_name=None)
    decide(file, place, "u and v have no standard names", "air", origin=[62.0, 5.0])
    file, lat, lon = projected("polar_stereographic", "m", "grid")
    decide(file, place, "origin: .* lies outside the projection", "air", origin=[-90.0, 5.0])


DISTANCES = {"depth": "down", "height": "up", "altitude": "up", "height_above_mean_sea_level": "up"}


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", sorted({*coordinate_criteria["Z"]["standard_name"], *coordinate_criteria["vertical"]["standard_name"]})
)
def test_every_vertical_axis_is_a_distance_or_refused_unless_chosen(name: str, place: Path) -> None:
    medium = "air" if DISTANCES.get(name) == "up" else "water"
    units = "Pa" if name == "air_pressure" else "m" if name in DISTANCES or "height" in name else "1"
    file = level(current() if medium == "water" else wind(), standard_name=name, units=units)
    if name in DISTANCES:
        decide(file, place, UNCHANGED, medium)
        decide(file, place, (1.25 * U, 1.25 * V), medium, depth=1.25)
    else:
        decide(file, place, "uo: has an axis level.*`select`: 1, 2, for example select: {level: 1}", medium)
    decide(file, place, (2.0 * U, 2.0 * V), medium, select={"level": 2})
    decide(file, place, "select: level has no 1.5; expected one of 1, 2", medium, select={"level": 1.5})
    scalar = (current() if medium == "water" else wind()).set("level", 3.0, (), standard_name=name, units=units)
    scalar.flow(coordinates="level")
    decide(scalar, place, UNCHANGED if name in DISTANCES else "uo: has an axis level", medium)
    decide(scalar, place, UNCHANGED, medium, select={"level": 3})


@pytest.mark.parametrize("unit", ["millibars", "hPa", "kg m-3", "1", "level", None])
def test_axes_of_pressure_density_and_layers_are_refused(unit: str | None, place: Path) -> None:
    file = level(wind(), units=unit, long_name="pressure_level", values=np.array([1000, 850]))
    decide(file, place, "uo: has an axis level.*: 1000, 850, for example select: {level: 1000}", "air")
    decide(file, place, UNCHANGED, "air", select={"level": 1000})


@pytest.mark.slow
def test_distances_by_unit_and_direction(place: Path) -> None:
    def deep(*values: float, units: str = "m", **attrs: Any) -> File:
        return level(current(), standard_name="depth", units=units, values=np.array(values), **attrs)

    bare = level(current(), values=np.array([0.0, -10.0])).rename(level="depth")
    for file in (deep(0.0, 0.01, units="km", positive="down"), deep(0.0, -10.0, positive="up"), bare):
        decide(file, place, (1.5 * U, 1.5 * V), depth=5.0)
    decide(deep(-1.0, 1.0), place, "level goes from -1 to 1 m")
    decide(deep(1.0, np.nan), place, "missing values")
    decide(level(current(), standard_name="height", units="m"), place, "level goes from 1 to 2 m up")
    decide(level(wind(), standard_name="depth", units="m"), place, "level goes from 1 to 2 m down", "air")
    deep(10.0, 20.0).write(place)
    assert read(place).notes == ("the flow is that of level 10 m, the nearest to the surface in its file",)
    decide(deep(10.0, 20.0), place, "depth: 21 m is beyond the file's; expected up to 20 m", depth=21.0)
    decide(current(), place, "depth: the file has no axis of depth or height; expected none, not 3 m", depth=3.0)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "values", "chosen"),
    [
        ("realization", [0, 1], 0),
        ("number", [0, 1], 0),
        ("expver", ["0001", "0005"], "0001"),
        ("band", [7.5, 8.5], 7.5),
    ],
)
def test_further_axes_are_refused_unless_a_value_is_chosen(name: str, values: Any, chosen: Any, place: Path) -> None:
    file = level(current(), values=np.array(values)).rename(level=name)
    decide(file, place, f"uo: has an axis {name}.*expected one of its values in `select`")
    decide(file, place, UNCHANGED, select={name: chosen})
    decide(file, place, "uo has no axis 'other'", select={name: chosen, "other": 1})
    bare = current().values(lambda w: np.stack([w, w], 1), ("time", "member", "lat", "lon"))
    decide(bare, place, "has an axis member.*: 0, 1")
    decide(bare, place, UNCHANGED, select={"member": 1})
    alone = current().values(lambda w: w[:, None], ("time", "member", "lat", "lon"))
    decide(alone, place, UNCHANGED)


# -- time ----------------------------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize(
    "calendar",
    ["standard", "gregorian", "proleptic_gregorian", "noleap", "365_day", "all_leap", "366_day", "360_day", "julian"],
)
@pytest.mark.parametrize(
    "units", ["days since 2024-02-27", "hours since 1600-02-27 12:00", "seconds since 2024-02-27T00:00:00Z"]
)
def test_calendars_are_those_of_cftime(calendar: str, units: str, place: Path) -> None:
    numbers = np.array([0.0, 1.0, 3.5])
    current().set("time", numbers, calendar=calendar, units=units).write(place)
    year = units.split("since ")[1][:4]
    time = read(place, start=f"{year}-03-01T06:00").grid.time
    dates = cftime.num2date(numbers, units, calendar)
    start = cftime.datetime(int(year), 3, 1, 6, calendar=calendar)
    assert time == pytest.approx([(date - start).total_seconds() for date in dates], abs=1e-6)


@pytest.mark.parametrize(
    ("units", "wanted"),
    [
        ("minutes since 2026-05-01", [0.0, 60.0, 120.0]),
        ("hours since 2026-05-01 02:00 +02:00", [0.0, 3600.0, 7200.0]),
        ("Hour since 2026-05-01T00:00:00Z", [0.0, 3600.0, 7200.0]),
        ("months since 2026-05-01", "time has the unit 'months since 2026-05-01'; expected seconds"),
        ("seconds", "time has the unit 'seconds'; expected seconds, minutes, hours or days since a date"),
        (None, "time has the unit ''; expected"),
        ("days since the flood", "time has no dates"),
        ("hours since 01-05-2026", "time has no dates"),
        ("hours since 1/5/2026", "time has no dates"),
        ("hours since 2026-05-01 CET", "time has no dates"),
        ("hours since 2026-05-01 00:00 5:30", "time has no dates"),
    ],
)
def test_units_of_time(units: str | None, wanted: Any, place: Path) -> None:
    file = current().set("time", units=units)
    decide(file, place, wanted if isinstance(wanted, str) else UNCHANGED)
    if not isinstance(wanted, str):
        assert read(place, start="2026-05-01").grid.time == pytest.approx(wanted)


def test_means_over_time_are_in_the_middle_of_their_bounds(place: Path) -> None:
    bounds = np.column_stack([np.arange(3.0), np.arange(1.0, 4.0)])
    file = current().set("time", bounds="time_bnds").set("time_bnds", bounds, ("time", "nv"))
    file.write(place)
    assert read(place, start="2026-05-01").grid.time == pytest.approx([0.0, 3600.0, 7200.0])
    file.flow(cell_methods="area: mean time: mean").write(place)
    reading = read(place, start="2026-05-01")
    assert reading.grid.time == pytest.approx([1800.0, 5400.0, 9000.0])
    assert "means over the intervals time_bnds" in reading.notes[0]
    file.set("time", np.arange(3.0) + 0.5).write(place)
    assert read(place, start="2026-05-01").notes == ()
    file.set("time_bnds", bounds / 24.0, units="days since 2026-05-01")
    decide(file, place, "time_bnds is in 'days since 2026-05-01', and time in 'hours since")
    decide(file.set("time_bnds", 1.0, (), units=None), place, "cannot be read")


def test_one_time_or_none_is_a_steady_flow_and_said(place: Path) -> None:
    file = current().values(lambda w: w[0], ("lat", "lon")).drop("time")
    decide(file, place, UNCHANGED)
    assert read(place).notes == ("the flow is steady: its file has no times",)
    decide(file, place, "start: the file has no times; expected none", start="2026-05-01")
    file.set("time", 3.0, (), standard_name="time", units=HOURS).flow(coordinates="time")
    decide(file, place, UNCHANGED)
    assert read(place).notes == ("the flow is steady: its file has no times but 2026-05-01T03:00:00",)
    decide(current().values(lambda w: w[:1]).set("time", np.zeros(1)), place, UNCHANGED)


def test_forecasts_with_two_times_are_chosen_from(place: Path) -> None:
    file = current().values(lambda w: np.stack([w, 2.0 * w]), ("run", "step", "lat", "lon")).drop("time")
    file.set("run", np.array([0.0, 12.0]), ("run",), standard_name="forecast_reference_time", units=HOURS)
    file.set("step", np.array([0.0, 1.0, 2.0]), ("step",), standard_name="forecast_period", units="hours")
    decide(file, place, "uo: has an axis run.*: 2026-05-01T00:00:00, 2026-05-01T12:00:00, for example")
    decide(file, place, (2.0 * U, 2.0 * V), select={"run": "2026-05-01T12:00"})
    assert read(place, start="2026-05-01", select={"run": "2026-05-01T12"}).grid.time == pytest.approx(
        [43200.0, 46800.0, 50400.0]
    )
    valid = np.array([[0.0, 1.0, 2.0], [12.0, 13.0, 14.0]])
    file.set("time", valid, ("run", "step"), standard_name="time", units=HOURS).flow(coordinates="time")
    decide(file, place, "uo: time has the axes run, step; expected a value of one of them in `select`")
    decide(file, place, UNCHANGED, select={"run": "2026-05-01T00"})


# -- C-grids -------------------------------------------------------------------------------------------------------


def staggered() -> File:
    """Return a file of a linear flow whose u and v lie on the sides of cells."""
    lat, lon = LATITUDE + 0.01 * np.arange(6), LONGITUDE + 0.01 * np.arange(7)
    file = current().drop("uo", "vo", "lat", "lon")
    file.set("lat", lat, ("lat",), units="degrees_north").set("lon", lon, ("lon",), units="degrees_east")
    file.set("lat_v", lat + 0.005, ("lat_v",), units="degrees_north")
    file.set("lon_u", lon + 0.005, ("lon_u",), units="degrees_east")
    u = np.broadcast_to(0.1 + 10.0 * (lon + 0.005 - LONGITUDE) + 5.0 * (lat[:, None] - LATITUDE), (3, 6, 7))
    v = np.broadcast_to(-0.1 + 3.0 * (lon - LONGITUDE) - 8.0 * (lat[:, None] + 0.005 - LATITUDE), (3, 6, 7))
    file.set("uo", u.copy(), ("time", "lat", "lon_u"), standard_name="sea_water_x_velocity", units="m s-1")
    file.set("vo", v.copy(), ("time", "lat_v", "lon"), standard_name="sea_water_y_velocity", units="m s-1")
    return file


def test_c_grids_are_brought_to_the_middles_of_their_cells(place: Path) -> None:
    """Land stays land."""
    file = staggered()
    file.write(place)
    reading = read(place)
    grid = reading.grid
    degree = np.radians(1.0) * 6_371_000.0
    lat, lon = grid.y[:, None] / degree, grid.x / degree / np.cos(np.radians(LATITUDE))
    assert grid.velocity.shape == (3, 5, 6, 3)
    assert grid.velocity[0, ..., 0] == pytest.approx(0.1 + 10.0 * lon + 5.0 * lat, abs=1e-9)
    assert grid.velocity[0, ..., 1] == pytest.approx(-0.1 + 3.0 * lon - 8.0 * lat, abs=1e-9)
    assert "C-grid" in reading.notes[0]
    file.variables["uo"][1][:, 2, 3] = np.nan
    file.write(place)
    u = read(place).grid.velocity[0, ..., 0]
    assert np.isnan(u[1, 2:4]).all()
    assert np.isnan(u).sum() == 2


def curvilinear(**attrs: Any) -> File:
    """Return a file whose places lie on no lines of latitude and longitude."""
    file = current().values(lambda w: w, ("time", "j", "i")).flow(**attrs)
    return file.set("lat", np.zeros((4, 5)), ("j", "i")).set("lon", np.zeros((4, 5)), ("j", "i"))


def timed(*values: Any) -> File:
    return current().set("time", np.array(values))


def unlike(name: str) -> File:
    file = current()
    return file.set(name, file.variables[name][1][0], ("lat", "lon"))


@pytest.mark.parametrize(
    ("file", "words", "fields"),
    [
        (current().set("uo", np.full((3, 4, 5), "a")), "uo: has values of type .*; expected numbers", {}),
        (current().set("uo", np.full((3, 4, 5), np.nan)), "uo: has no values", {}),
        (current().values(lambda w: w[:0]).set("time", np.zeros(0)), "uo: has no values", {}),
        (current(), r"origin: \(91, 7\) is no place", {"origin": [91.0, 7.0]}),
        (curvilinear(coordinates="lat lon"), "uo: the grid is curvilinear .*cdo remapbil", {}),
        (timed(0.0, np.nan, 2.0), "time has missing values", {}),
        (timed(0, -(2**63), 2), "time has missing values|time has no dates|do not rise", {}),
        (timed(2.0, 1.0, 0.0), "times do not rise", {}),
        (timed(0.0, 1.0, 1.0), "times do not rise", {}),
        (timed("a", "b", "c"), "time has missing values|time has the unit", {}),
        *(
            (current(), f"start: .{start}. is no date", {"start": start})
            for start in ("today", "NaT", "1600-01-01", "20260501", "2026-13-01")
        ),
        (unlike("uo"), "uo and vo have different times", {}),
        (unlike("vo"), "uo and vo have different times", {}),
        (staggered().drop("lat_v"), "vo: has no latitude", {}),
    ],
)
def test_what_is_not_understood_is_refused(file: File, words: str, fields: dict[str, Any], place: Path) -> None:
    decide(file, place, words, **fields)


# -- content -------------------------------------------------------------------------------------------------------


def scenario(path: Path) -> Scenario:
    water = {"kind": "gridded", "path": str(path), "origin": [LATITUDE, LONGITUDE]}
    return pursuit([0, 0], [5, 5], time={"end": 2.0}, flow={"water": water})


def test_a_file_that_is_replaced_is_read_anew_and_the_earlier_run_is_not_saved_with_it(
    place: Path, tmp_path: Path
) -> None:
    current().write(place)
    early = scenario(place)
    run = mjsheaf.simulate(early, "ideal")
    stamp = place.stat()
    current().set("uo", np.full((3, 4, 5), -0.7)).write(tmp_path / "new.nc")
    place.write_bytes((tmp_path / "new.nc").read_bytes())
    os.utime(place, ns=(stamp.st_atime_ns, stamp.st_mtime_ns))
    late = mjsheaf.simulate(scenario(place), "ideal")
    assert late.agent_flow.values[0, 0, 0] == -0.7
    assert mjsheaf.simulate(early, "ideal").agent_flow.values[0, 0, 0] == U  # what it has read, it keeps
    with pytest.raises(InputError, match=r"flow\.water\.path: .*flow.nc has changed since"):
        mjsheaf.save(run, tmp_path / "early", video=False)
    read_flow.cache_clear()
    with pytest.raises(InputError, match=r"flow: current: path: .*flow.nc: has changed since"):
        scenario_from_mapping(early.model_dump(exclude_none=True))


@pytest.mark.usefixtures("without_plots")
def test_the_copy_of_a_run_is_what_it_met(place: Path, tmp_path: Path) -> None:
    current().write(place)
    run = mjsheaf.simulate(scenario(place), "ideal")
    mjsheaf.save(run, tmp_path / "run", video=False)
    assert list((tmp_path / "run" / "vehicles").rglob("*.nc"))
    (tmp_path / "run").rename(tmp_path / "moved")
    place.unlink()
    again = mjsheaf.simulate(load_scenario(tmp_path / "moved" / "scenario.yaml"), "ideal")
    assert np.array_equal(again.agent_position, run.agent_position, equal_nan=True)


@pytest.mark.parametrize("name", ["flow.nc", "flow.nc4", "flow.cdf", "flow"])
def test_paths_out_of_the_directory_and_pipes_are_refused(name: str, tmp_path: Path) -> None:
    current().write(tmp_path / name)
    (tmp_path / "inside").mkdir()
    file = tmp_path / "inside" / "s.yaml"
    for path, words in ((f"../{name}", "lies outside"), (name, "there is no file")):
        water = {"kind": "gridded", "path": path, "origin": [43, 7]}
        file.write_text(json.dumps(ONE_BOAT | {"flow": {"water": water}}))
        with pytest.raises(InputError, match=words):
            load_scenario(file)
    os.mkfifo(tmp_path / "inside" / name)
    with pytest.raises(InputError, match="no regular file"):
        load_scenario(file)
    (tmp_path / "inside" / name).unlink()
    current().write(tmp_path / "inside" / name)
    assert load_scenario(file).flow.water is not None


def test_a_proposal_about_a_projected_grid(place: Path) -> None:
    file, lat, lon = projected("polar_stereographic", "m", "grid")
    file.write(place)
    found = propose(str(place))
    assert (found.medium, found.start) == ("air", None)
    off = np.hypot(found.origin[0] - lat, (found.origin[1] - lon) * np.cos(np.radians(62.0)))
    assert off.min() < 1e-5
    assert found.clear > 3000.0


@pytest.fixture(autouse=True)
def _fresh() -> None:
    read_flow.cache_clear()
