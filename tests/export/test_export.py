"""Exported runs, read back with the readers of the formats' own packages.

Oracles: the run's data; the two formats, which say the same; the same run written again, or in other pieces.
"""

import json
import struct
import sys
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
import zstandard
from mcap.reader import make_reader
from mcap.records import Chunk, Footer
from mcap.stream_reader import CRCValidationError, StreamReader
from mcap_protobuf.decoder import DecoderFactory
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore
from scipy.spatial.transform import Rotation

from mjsheaf import load_scenario, simulate
from mjsheaf.errors import InputError
from mjsheaf.export import export_run
from mjsheaf.export.log import FORMATS, PALETTE, TOPICS, require_installed
from mjsheaf.export.mcap import MAX_FIELDS, make_messages, turn_along
from mjsheaf.results.store import send, split
from mjsheaf.runs.publish import execute
from mjsheaf.scenario import Scenario
from tests.commands import answer_of, is_refusal
from tests.oracles.law import residual


@pytest.fixture(scope="module")
def scenario() -> Scenario:
    return load_scenario("altitude_anchor", {"time.end": 0.5})


@pytest.fixture(scope="module", params=["ideal", "physics"])
def run(request: pytest.FixtureRequest, scenario: Scenario) -> xr.Dataset:
    return simulate(scenario, backend=request.param)


def write(name: str, path: Path, run: xr.Dataset, scenario: Scenario, samples: int = 10**6) -> Path:
    source = path.parent / "scenario.yaml"
    source.write_text("name: it\n")
    (kind,) = require_installed([name])
    send(split(run, samples), kind(path, scenario, scenario.phases, source))
    return path


Messages = dict[str, list[tuple[int, Any]]]


def messages(path: Path) -> Messages:
    """Return the messages of an MCAP file by topic, each with its time, ns; CRCs are checked."""
    found: Messages = {}
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
        for _, channel, message, decoded in reader.iter_decoded_messages():
            found.setdefault(channel.topic, []).append((message.log_time, decoded))
    return found


def bag(path: Path) -> Messages:
    """Return the messages of a bag of ROS 2 by topic, each with its time, ns."""
    found: Messages = {}
    with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_JAZZY)) as reader:
        for connection, time, data in reader.messages():
            found.setdefault(connection.topic, []).append((time, reader.deserialize(data, connection.msgtype)))
    return found


def poses_of(run: xr.Dataset, scenario: Scenario) -> dict[str, np.ndarray]:
    """Return position and quaternion x, y, z, w of each vehicle, from the data."""
    found = {}
    for kind in ("agent", "target"):
        for k, name in enumerate(run[kind].values.tolist()):
            if run.attrs["backend"] == "physics":
                turn = run[f"{kind}_orientation"].values[:, k][:, [1, 2, 3, 0]]
                found[name] = np.column_stack([run[f"{kind}_body_position"].values[:, k], turn])
            else:
                place = run[f"{kind}_position"].values[:, k]
                height = np.where(np.isnan(place[:, 2]), scenario.scene.height, place[:, 2])
                found[name] = np.column_stack([place[:, :2], height, np.tile([0.0, 0, 0, 1], (len(place), 1))])
    return found


def numbers(message: Any, names: str) -> list[float]:
    return [getattr(message, name) for name in names]


@pytest.mark.slow(first=True)
def test_a_run_without_targets_is_exported(tmp_path: Path) -> None:
    """What would have no columns is left out."""
    team = load_scenario("range_formation", {"time.end": 0.1})
    run = simulate(team)
    assert not run.sizes["target"]
    found = messages(write("mcap", tmp_path / "run.mcap", run, team))
    assert len(found["/errors"]) == len(found["/tf"]) == run.sizes["time"]
    fields = found["/errors"][0][1].DESCRIPTOR.fields_by_name
    assert {"disagreement", "tracking_error"} <= set(fields)
    assert all(run[name].size for name in fields)
    assert "/vehicles" in bag(write("ros2", tmp_path / "bag", run, team))


READERS = {
    "mcap": (messages, ("/errors", "/commands")),
    "ros2": (bag, ("/errors/disagreement", "/commands/velocity_command")),
}


@pytest.mark.parametrize("name", READERS)
def test_poses_counts_and_values_of_a_bag_are_those_of_the_run(
    name: str, run: xr.Dataset, scenario: Scenario, tmp_path: Path
) -> None:
    read, topics = READERS[name]
    found = read(write(name, tmp_path / name, run, scenario, samples=7))
    times = np.rint(1e9 * run["time"].values).astype(int).tolist()
    for topic in ("/tf", "/scene", *topics):
        assert [time for time, _ in found[topic]] == times, topic
    expected = poses_of(run, scenario)
    for k, (time, message) in enumerate(found["/tf"]):
        assert [t.child_frame_id for t in message.transforms] == list(expected)
        for one in message.transforms:
            place = one if name == "mcap" else one.transform
            pose = numbers(place.translation, "xyz") + numbers(place.rotation, "xyzw")
            assert pose == expected[one.child_frame_id][k].tolist()
            if name == "mcap":
                assert one.timestamp.seconds * 10**9 + one.timestamp.nanos == time
    if name == "mcap":
        assert len(found["/vehicles"]) == 1
        assert {e.frame_id for e in found["/vehicles"][0][1].entities} == set(expected)
        return
    for topic in (topic for topic in found if topic.startswith("/errors/")):
        np.testing.assert_array_equal(found[topic][-1][1].data, np.ravel(run[topic.rpartition("/")[2]].values[-1]))
    assert {marker.header.frame_id for _, message in found["/scene"] for marker in message.markers} == {"world"}


def test_values_are_those_of_the_run_to_twelve_bits(run: xr.Dataset, scenario: Scenario, tmp_path: Path) -> None:
    found = messages(write("mcap", tmp_path / "run.mcap", run, scenario))
    seen = set()
    for topic in TOPICS:
        for k, (_, message) in enumerate(found[f"/{topic}"]):
            for field in message.DESCRIPTOR.fields:
                value = getattr(message, field.name)
                if field.message_type is not None:
                    value = [getattr(value, own.name) for own in field.message_type.fields]
                np.testing.assert_allclose(np.array(value), run[field.name].values[k], rtol=2.0**-12, equal_nan=True)
                seen.add(field.name)
    assert {"disagreement", "tracking_error", "velocity_command", "command"} <= seen


@pytest.mark.parametrize("name", sorted(FORMATS))
def test_equal_runs_give_equal_bytes_whatever_their_pieces(
    name: str, run: xr.Dataset, scenario: Scenario, tmp_path: Path
) -> None:
    written = []
    for samples in (10**6, 1, 13):
        place = tmp_path / str(samples)
        place.mkdir()
        path = place / "out"
        if name == "ros2":
            path.mkdir()
        write(name, path, run, scenario, samples)
        files = [path] if path.is_file() else sorted(path.iterdir())
        written.append({file.name: file.read_bytes() for file in files})
    assert written[0] == written[1] == written[2]


@pytest.mark.parametrize("name", ["mcap", "ros2"])
def test_every_part_of_the_file_has_its_checksum(
    run: xr.Dataset, scenario: Scenario, tmp_path: Path, name: str
) -> None:
    path = write(name, tmp_path / ("run.mcap" if name == "mcap" else "run"), run, scenario)
    if name == "ros2":
        (path,) = path.glob("*.mcap")
    with path.open("rb") as file:
        records = list(StreamReader(file, emit_chunks=True, validate_crcs=True).records)
    chunks = [record for record in records if isinstance(record, Chunk)]
    assert chunks
    for chunk in chunks:
        assert chunk.uncompressed_crc == zlib.crc32(zstandard.decompress(chunk.data, chunk.uncompressed_size)) != 0
    assert isinstance(records[-1], Footer)
    summary = path.read_bytes()[records[-1].summary_start : -12]
    assert records[-1].summary_crc == zlib.crc32(summary) != 0
    crc = chunks[0].uncompressed_crc
    path.write_bytes(path.read_bytes().replace(struct.pack("<I", crc), struct.pack("<I", crc ^ 1)))
    with path.open("rb") as file, pytest.raises(CRCValidationError):
        list(StreamReader(file, validate_crcs=True).records)


def test_edges_are_coloured_by_their_residuals_and_join_their_ends(scenario: Scenario, tmp_path: Path) -> None:
    run = simulate(scenario, backend="ideal")
    found = messages(write("mcap", tmp_path / "run.mcap", run, scenario))
    team, poses = scenario.system.team, poses_of(run, scenario)
    edges = [*team.communication, *team.sensing]
    for k in (0, len(found["/scene"]) - 1):
        drawn = {}
        for line in found["/scene"][k][1].entities[0].lines:
            level = int(np.abs(PALETTE[:, :3] - numbers(line.color, "rgb")).sum(axis=1).argmin())
            points = [tuple(numbers(point, "xyz")) for point in line.points]
            for tail, head in np.reshape(line.indices, (-1, 2)):
                drawn[points[tail], points[head]] = level
        expected = {}
        for edge in edges:
            tail, head = (poses[end][k, :3] for end in (edge.tail, edge.head))
            x = np.array([poses[member.id][k, :3] for member in team.members])
            part = np.log10(residual(team, edge, x) / 0.01) / 3.0
            expected[tuple(tail.tolist()), tuple(head.tolist())] = int(np.clip(np.floor(16 * part), 0, 15))
        assert drawn == expected


def test_arrows_point_along_the_flow() -> None:
    rng = np.random.default_rng(1)
    velocities = np.concatenate([rng.standard_normal((200, 3)), -np.eye(3), np.eye(3)])
    quaternions, speeds = turn_along(velocities)
    for velocity, (x, y, z, w), speed in zip(velocities, quaternions, speeds, strict=True):
        norm = x * x + y * y + z * z + w * w
        along = np.array([1.0 - 2.0 * (y * y + z * z) / norm, 2.0 * (x * y + z * w), 2.0 * (x * z - y * w)])
        assert speed * along == pytest.approx(velocity, abs=0.08 * float(np.linalg.norm(velocity)))


def test_arrows_are_in_the_frames_of_their_vehicles(run: xr.Dataset, scenario: Scenario, tmp_path: Path) -> None:
    found = messages(write("mcap", tmp_path / "run.mcap", run, scenario))
    poses = poses_of(run, scenario)
    flows = {kind: np.nan_to_num(run[f"{kind}_flow"].values) for kind in ("agent", "target")}
    drawn = 0
    for k, (_, scene) in enumerate(found["/scene"]):
        arrows = {entity.frame_id: entity for entity in scene.entities if entity.id.startswith("flow ")}
        assert list(arrows) == list(poses)
        for kind, flow in flows.items():
            for name, velocity in zip(run[kind].values.tolist(), flow[k], strict=True):
                assert arrows[name].frame_locked
                assert len(arrows[name].arrows) == (np.linalg.norm(velocity) >= 2.0**-6)
                for arrow in arrows[name].arrows:
                    turns = Rotation.from_quat([poses[name][k, 3:], numbers(arrow.pose.orientation, "xyzw")])
                    along = turns[0].apply(turns[1].apply([arrow.shaft_length + arrow.head_length, 0.0, 0.0]))
                    assert along == pytest.approx(velocity, abs=0.08 * float(np.linalg.norm(velocity)))
                    drawn += 1
    assert drawn


def test_labels_become_different_fields_that_protobuf_allows() -> None:
    labels = ["A-1", "A_1", "a", *(f"S{k}" for k in range(MAX_FIELDS - 3))]
    kind = make_messages({"disagreement": labels, "formation_error": []}, ())["errors"]
    message = kind(formation_error=0.5)
    fields = kind.DESCRIPTOR.fields_by_name["disagreement"].message_type.fields
    assert len({field.name for field in fields}) == len(labels)
    setattr(message.disagreement, fields[-1].name, 2.0)
    again = kind.FromString(message.SerializeToString())
    assert again == message
    assert getattr(again.disagreement, fields[-1].name) == 2.0
    more = make_messages({"disagreement": ["S"] * 20_000, "command": labels}, ["command"])
    assert more["errors"](disagreement=[1.0] * 20_000).disagreement[-1] == 1.0
    assert more["commands"]().command.A_1 == []


@pytest.mark.long
def test_a_run_of_the_paper_s_team_stays_small(tmp_path: Path) -> None:
    """17 vehicles and 1,500 samples in at most 1.35 MB; on bodies 1 MB of attitudes and thrusters more."""
    scenario = load_scenario("paper", {"time.end": 15.0})
    for backend, limit in (("ideal", 1.35e6), ("physics", 2.35e6)):
        run = simulate(scenario, backend=backend).isel(time=slice(0, 1500))
        assert run.sizes["time"] == 1500
        assert write("mcap", tmp_path / f"{backend}.mcap", run, scenario).stat().st_size <= limit


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run with an event, exported while it ran."""
    directory = tmp_path_factory.mktemp("finished") / "run"
    scenario = load_scenario("harbour_lost_hexarotor", {"time.end": 46.0, "controller.control_period": 0.2})
    execute(scenario, "ideal", directory, video=None, exports=["mcap", "ros2"])
    return directory


@pytest.mark.long
def test_a_finished_run_exports_what_the_running_one_did(finished: Path, tmp_path: Path) -> None:
    path = export_run(finished, "mcap", tmp_path / "again.mcap")
    assert path.read_bytes() == (finished / "run.mcap").read_bytes()
    folder = export_run(finished, "ros2", tmp_path / "again")
    for file in (finished / "run_ros2").iterdir():
        assert (folder / file.name).read_bytes() == file.read_bytes()
    scenario = load_scenario("harbour_lost_hexarotor", {"time.end": 46.0, "controller.control_period": 0.2})
    execute(scenario, "ideal", finished, video=None, exports=["mcap"])  # replaces the directory
    assert not (finished / "run_ros2").exists()


@pytest.mark.long
def test_events_are_messages_and_the_lost_agent_is_not_drawn(finished: Path) -> None:
    found = messages(finished / "run.mcap")
    told = [(time, message.message) for time, message in found["/log"]]
    assert [time for time, _ in told] == [0, 45 * 10**9]
    assert "H3" in told[1][1]
    goals = {time: len(scene.entities[1].spheres) for time, scene in found["/scene"]}
    assert goals[44 * 10**9] == 8
    assert goals[45 * 10**9] == 7
    with (finished / "run.mcap").open("rb") as file:
        attachments = list(make_reader(file).iter_attachments())
    assert [attachment.data for attachment in attachments] == [(finished / "scenario.yaml").read_bytes()]


@pytest.mark.long
def test_a_failed_export_leaves_what_was_there(finished: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    before = {path.name: path.read_bytes() for path in finished.iterdir() if path.is_file()}

    def full(*_: Any) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("mjsheaf.export.mcap.Log._scene", full)
    monkeypatch.setattr("mjsheaf.export.ros2.Log._scene", full)
    for name in FORMATS:
        with pytest.raises(InputError, match="No space left"):
            export_run(finished, name)
    assert {path.name: path.read_bytes() for path in finished.iterdir() if path.is_file()} == before
    assert not any("part" in path.name for path in finished.iterdir())


def test_mistakes_are_named(tmp_path: Path) -> None:
    empty, out = tmp_path / "empty", ("--out", tmp_path / "run.mcap")
    empty.mkdir()
    assert is_refusal(answer_of("export", tmp_path), "expected --mcap, --ros2 or both")
    assert is_refusal(answer_of("export", empty, "--mcap"), "holds no result.nc")
    answer = answer_of("export", tmp_path, "--mcap", "--out", tmp_path / "run.bag")
    assert is_refusal(answer, "expected a file whose name ends in .mcap")
    assert is_refusal(answer_of("export", tmp_path, "--mcap", "--ros2", *out), "only one of --mcap and --ros2")
    assert not list(empty.iterdir())


@pytest.mark.parametrize(("name", "package"), [("mcap", "mcap_protobuf"), ("ros2", "rosbags")])
def test_a_missing_package_is_named_before_the_run(
    name: str, package: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    for module in list(sys.modules):
        if module == f"mjsheaf.export.{name}" or module.split(".")[0] == package:
            monkeypatch.delitem(sys.modules, module)
    monkeypatch.setitem(sys.modules, package, None)
    scenario = load_scenario("midpoint")
    with pytest.raises(InputError, match=rf"--{name} needs .*pip install 'mjsheaf\[mcap\]'"):
        execute(scenario, "ideal", tmp_path / "run", video=None, exports=[name])
    assert not (tmp_path / "run").exists()


def test_a_bag_replaces_only_a_bag(tmp_path: Path) -> None:
    from mjsheaf.results.store import strange_in_bag

    folder = tmp_path / "run_ros2"
    assert strange_in_bag(folder) == []
    folder.mkdir()
    (folder / "metadata.yaml").write_text(json.dumps({}))
    assert strange_in_bag(folder) == []
    (folder / "thesis.tex").write_text("")
    assert strange_in_bag(folder) == ["thesis.tex"]
