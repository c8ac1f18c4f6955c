"""Positions in tables: each dialect is read by the titles of its columns, or refused in a line that says why.

Oracle: one path, written in each dialect by hand.
"""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mjsheaf.errors import InputError
from mjsheaf.recordings import read_positions
from mjsheaf.recordings.cf import EARTH

PATH = [[0.0, 1.0, 2.0, 3.0], [0.5, 2.0, 4.0, 3.5], [2.0, 3.0, 8.0, 4.0]]
PLANE = [row[:3] for row in PATH]
ORIGIN = {"origin": [60.0, 10.0]}
METRE = np.radians(1.0) * EARTH
DEGREES = [[0, 0, 0, 3], [0.5, 1e-4 * METRE / 2, 2e-4 * METRE, 3.5], [2.0, 2e-4 * METRE / 2, 4e-4 * METRE, 4]]
BODY = "0,1,2,3\n0.5,2,4,3.5\n2,3,8,4\n"
FIXES = "60,10,3\n60.0002,10.0001,3.5\n60.0004,10.0002,4\n"
CLOCK = 1_403_715_524_907_143_168


def rows(*columns: Any, sep: str = ",") -> str:
    return "".join(sep.join(map(str, row)) + "\n" for row in zip(*columns, strict=True))


def fixes(times: list[Any]) -> str:
    return "".join(f"{t},{line}\n" for t, line in zip(times, FIXES.split(), strict=True))


T, X, Y, Z = (list(column) for column in zip(*PATH, strict=True))
QUATERNION = [0.6, 0.6, 0.6], [0, 0, 0], [0.8, 0.8, 0.8], [0, 0, 0]
DIALECTS: dict[str, str | tuple[str, dict[str, Any], Any]] = {
    "without titles": BODY,
    "in the plane": (rows(T, X, Y), {}, PLANE),
    "any order": ("Y, Time ,label,X\n" + rows(Y, T, "abc", X), {}, PLANE),
    "byte order mark": "\ufefft,x,y,z\n" + BODY,
    "Windows": ("t,x,y,z\n" + BODY).replace("\n", "\r\n"),
    "units in brackets": "t [ms],x (km),y [m],z [cm]\n"
    + rows([0, 500, 2000], [0.001, 0.002, 0.003], Y, [300, 350, 400]),
    "units after underscores": "time_s,x_m,y_km,z_m\n" + rows(T, X, [0.002, 0.004, 0.008], Z),
    "units of time without underscores": "TimeUS,x,y,z\n" + rows([0, 500000, 2000000], X, Y, Z),
    "semicolons": "t;x;y;z\n" + BODY.replace(",", ";"),
    "tabs": "t\tx\ty\tz\n" + BODY.replace(",", "\t"),
    "blanks": "t  x y   z\n" + BODY.replace(",", "  "),
    "quotes": ('"t","x","y","note"\n' + rows(T, X, Y, ['"a,b"'] * 3), {}, PLANE),
    "titles in a comment": "# made by hand\n# t,x,y,z\n" + BODY,
    "another comment": "# made by hand\n" + BODY,
    "columns at the end that are empty": BODY.replace("\n", ",,\n"),
    "TUM": rows(T, X, Y, Z, *QUATERNION, sep=" "),
    "TUM with a comment": "# timestamp tx ty tz qx qy qz qw\n" + rows(T, X, Y, Z, *QUATERNION, sep=" "),
    "TUM of a clock": rows([1311868163.8697, 1311868164.3697, 1311868165.8697], X, Y, Z, *QUATERNION, sep=" "),
    "EuRoC": "#timestamp [ns], p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m], q_RS_w [], v_RS_R_x [m s^-1]\n"
    + rows([CLOCK, CLOCK + 500_000_000, CLOCK + 2_000_000_000], X, Y, Z, *QUATERNION[:1], [9, 9, 9]),
    "nanoseconds of a clock, by a plural that is no unit": (
        "timestamps,x,y\n" + rows([CLOCK, CLOCK + 1, CLOCK + 2], X, Y),
        {},
        [[0, 1, 2], [1e-9, 2, 4], [2e-9, 3, 8]],
    ),
    "rostopic echo -p": (
        "%time,field.header.seq,field.header.stamp,field.header.frame_id,field.pose.position.x,field.pose.position.y,"
        "field.pose.position.z,field.pose.orientation.x\n"
        + rows(
            [CLOCK, CLOCK + 7, CLOCK + 9],
            [1, 2, 3],
            [CLOCK, CLOCK + 5 * 10**8, CLOCK + 2 * 10**9],
            ["map"] * 3,
            *(X, Y, Z),
            [0] * 3,
        )
    ),
    "PlotJuggler": (
        "__time,/odom/pose/pose/position/x,/odom/pose/pose/position/y,/odom/twist/twist/linear/x\n"
        + rows(T, X, Y, [9, 9, 9]),
        {},
        PLANE,
    ),
    "east, north, up": "t,north,east,up\n" + rows(T, Y, X, Z),
    "north, east, down": "t,north_m,east_m,down_m\n" + rows(T, Y, X, [-3, -3.5, -4]),
    "depth": "t,x,y,depth\n" + rows(T, X, Y, [-3, -3.5, -4]),
    "axes ned": ("t,x,y,z\n" + rows(T, Y, X, [-3, -3.5, -4]), {"axes": "ned"}, PATH),
    "axes ned with a height": ("t,x,y,alt\n" + rows(T, Y, X, Z), {"axes": "ned"}, PATH),
    "PX4": (
        "timestamp [us],x,y,z,xy_valid\n" + rows([0, 5e5, 2e6], Y, X, [-3, -3.5, -4], [1] * 3),
        {"axes": "ned"},
        PATH,
    ),
    "degrees": ("time,lat,lon,alt\n" + fixes(T), ORIGIN, DEGREES),
    "degrees with units": ("time [s],latitude [deg],longitude [deg],altitude [m]\n" + fixes(T), ORIGIN, DEGREES),
    "degrees and metres, degrees asked for": (
        "time,lat,lon,alt,x,y\n" + fixes(T).replace("\n", ",7,7\n"),
        ORIGIN,
        DEGREES,
    ),
    "dates with a zone": (
        "Timestamp,Lat,Lng,ele\n"
        + fixes(["2026-05-01 06:00:00+00:00", "2026-05-01 08:00:00.5+02:00", "2026-05-01 06:00:02+00:00"]),
        ORIGIN,
        DEGREES,
    ),
    "AIS": (
        "MMSI,BaseDateTime,LAT,LON\n"
        + rows([7, 8, 7], ["2026-05-01T06:00:00"] * 2 + ["2026-05-01T06:00:09"], [60, 1, 60], [10, 1, 10]),
        {"topic": "7", **ORIGIN},
        [[0, 0, 0], [9, 0, 0]],
    ),
    "one vehicle": ("mmsi,t,x,y\n" + rows([7, 7, 7], T, X, Y), {}, PLANE),
    "rows without a fix": ("t,lat,lon,alt\n0.1,,,\n" + fixes(T), ORIGIN, DEGREES),
    "a velocity named u": ("t,x,y,u,v\n" + rows(T, X, Y, [9] * 3, [9] * 3), {}, PLANE),
}


@pytest.mark.parametrize("dialect", DIALECTS)
def test_a_dialect_is_read(dialect: str, tmp_path: Path) -> None:
    case = DIALECTS[dialect]
    text, fields, expected = case if isinstance(case, tuple) else (case, {}, PATH)
    (tmp_path / "a.csv").write_bytes(text.encode())
    np.testing.assert_allclose(read_positions(str(tmp_path / "a.csv"), **fields), expected, rtol=1e-9, atol=1e-7)


@pytest.mark.parametrize(
    ("text", "fields", "message"),
    [
        ("t;x;y\n0;1,5;2\n", {}, r"line 2: '1,5' has a decimal comma; expected points"),
        ("0;1,5;2\n1;2;3\n", {}, "expected a table of numbers with columns t, x, y"),
        ("0,1\n1,2\n", {}, "has 2 columns without titles"),
        (rows(T, X, Y, Z, *[[1, 1, 1]] * 4), {}, "has 8 columns without titles"),
        ("t,x,y,pos_x\n0,1,2,3\n", {}, "columns 'x' and 'pos_x' are both x; expected one"),
        ("t,x [s],y\n0,1,2\n", {}, "column x: the unit is 's'; expected m"),
        ("t,lat [m],lon\n0,1,2\n", ORIGIN, "column latitude: the unit is 'm'"),
        ("t,vx,vy\n0,1,2\n", {}, "expected a table of numbers"),
        ("t,lat,lon\n0,60,10\n", {}, "origin: missing; positions are in degrees"),
        ("t,lat,lon\n0,95,10\n", ORIGIN, "latitude is 95; expected degrees"),
        ("t,lat,lon\n0,0,0\n", ORIGIN, "a position is at 0, 0 degrees"),
        ("t,x,y\n0,1,2\n", ORIGIN, "origin: positions are in metres"),
        ("t,north,east\n0,1,2\n", {"axes": "ned"}, "axes: the file names the directions"),
        ("timestamp,x,y,z,xy_valid\n0,1,2,3,1\n", {}, "axes: missing; columns with xy_valid are PX4's"),
        ("t,x,y\n0,1,2\n", {"topic": "/tf"}, "topic: this kind of file has none"),
        ("mmsi,t,x,y\n1,0,1,2\n2,0,1,2\n", {}, "topic: missing; expected 1, 2"),
        ("mmsi,t,x,y\n1,0,1,2\n2,0,1,2\n", {"topic": "3"}, "topic: there is no '3'; expected 1, 2"),
        ("t,x,y\n12/Nov/2022 04:22:36,1,2\n", {}, "times begin at '12/Nov/2022 04:22:36'; expected seconds, or dates"),
        ("t,x,y\n300000000,1,2\n", {}, r"times begin at 300000000; expected their unit in the title"),
        ("timestamp,x,y\n1700000000,1,2\n1760000000,1,2\n", {}, "times begin at 1700000000; expected their unit"),
        ("t,x,y\n0,nan,2\n", {}, "line 2: expected a number in each column"),
        ("t,x,y\n0,0,0\n1,0,1,5,2,5\n", {}, "line 3: has 6 cells under 3 titles; expected points"),
        ("t,lat,N/S,lon,E/W\n0,33,S,70,W\n", {"origin": [33, 70]}, "a column has hemispheres, S; expected negative"),
        ("t,x,y,z,alt\n0,0,0,5,105\n", {}, "columns z and up are both there"),
        ("t,pos_err_x,pos_err_y\n0,0,0\n", {}, "expected a table of numbers"),
        ("t,lat,lon\n0,60,10\n", {"origin": [95, 10]}, r"origin: \(95, 10\) is no place"),
        (
            "t,lat,lon\n0,7,43\n",
            {"origin": [43, 7]},
            r"origin: the nearest position is \d+ km away from 43, 7; expected latitude, then long",
        ),
        ("t,x,y\n0,1,2\n1,2\n", {}, "line 3: expected a number in each column, not '1,2'"),
    ],
)
def test_what_is_not_understood_is_refused_in_one_line(
    text: str, fields: dict[str, Any], message: str, tmp_path: Path
) -> None:
    (tmp_path / "a.csv").write_text(text)
    with pytest.raises(InputError, match=rf"^[^\n]*a\.csv: {message}[^\n]*$"):
        read_positions(str(tmp_path / "a.csv"), **fields)


@pytest.mark.parametrize("name", ["x" * 5000 + ".csv", "a\0b.csv", ""], ids=["too long", "a NUL", "none"])
def test_a_name_that_no_file_can_have_is_refused_in_one_line(name: str) -> None:
    with pytest.raises(InputError, match=r"^[^\n\0]{1,200}$"):
        read_positions(name)
