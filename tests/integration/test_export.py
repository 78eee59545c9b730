"""Exports of a recording of two real cameras and a real map, opened again by others' readers."""

import json
from collections import Counter, defaultdict

import numpy as np
import pytest

pytest.importorskip("foxglove_schemas_protobuf")

from PIL import Image

from schemas.camera import CameraPose, ColorImage
from schemas.cloud import DepthCloud
from schemas.map import MapChanges
from schemas.target import TargetPose
from services.kernels.rigid import apply
from services.launcher.cli import dispatch
from services.mapper import formats
from services.mapper.stored_map import occupied
from services.recorder.log_file import RecordedLog
from services.runtime.map_mirror import MapMirror
from tests.small_recording import DT_NS, NUM_CAMERAS, OPTICS, VOXEL_M, SmallRecording

pytestmark = pytest.mark.integration

NUM_TICKS = 12


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    return SmallRecording(tmp_path_factory.mktemp("recording") / "small.mcap", NUM_TICKS)


def export(recording, capsys, *flags):
    """Carry out `encircle export`; return its exit code and what it said."""
    code = dispatch(["export", str(recording.path), *flags])
    captured = capsys.readouterr()
    return code, captured.out + captured.err


def decoded(path):
    """Return topics and messages, decoded by MCAP's own reader, in order of time."""
    from mcap.reader import make_reader
    from mcap_protobuf.decoder import DecoderFactory

    found = defaultdict(list)
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        for schema, channel, message in reader.iter_messages():
            if channel.message_encoding == "json":
                found[channel.topic].append((message.log_time, json.loads(message.data)))
                continue
            decoder = DecoderFactory().decoder_for(channel.message_encoding, schema)
            found[channel.topic].append((message.log_time, decoder(message.data)))
    return found


def test_every_foxglove_message_can_be_decoded_and_says_what_we_said(recording, capsys, tmp_path):
    out = tmp_path / "out.mcap"
    code, said = export(
        recording, capsys, "--to", "foxglove", "--out", str(out), "--pixel-step", "8"
    )
    assert code == 0, said
    found = decoded(out)
    names = {topic: type(messages[0][1]).__name__ for topic, messages in found.items()}
    for camera in range(NUM_CAMERAS):
        assert names[f"/cams/{camera}/depth"] == "RawImage"
        assert names[f"/cams/{camera}/points"] == "PointCloud"
        assert names[f"/cams/{camera}/calibration"] == "CameraCalibration"
        assert names[f"/cams/{camera}/pose"] == "PoseInFrame"
    assert names["/cams/0/color"] == "CompressedImage"
    assert names["/tf"] == "FrameTransform"
    assert names["/formation"] == "SceneUpdate"
    frames = {message.child_frame_id for _, message in found["/tf"]}
    assert frames == {"target", "cam_0_optical", "cam_1_optical"}
    assert {message.parent_frame_id for _, message in found["/tf"]} == {"world"}

    clouds = [each for each in recording.of(DepthCloud) if each.camera == 1]
    for (t_ns, image), cloud in zip(found["/cams/1/depth"], clouds, strict=True):
        assert t_ns == cloud.t_ns == image.timestamp.seconds * 10**9 + image.timestamp.nanos
        pixels = np.frombuffer(image.data, "<u2").reshape(120, 160)
        np.testing.assert_array_equal(pixels, np.where(cloud.array == 65535, 0, cloud.array))
    for _, calibration in found["/cams/1/calibration"]:
        assert calibration.K[0] == OPTICS.fx
        assert calibration.K[2] == OPTICS.cx
    poses = [each for each in recording.of(CameraPose) if each.camera == 0]
    for (_, message), pose in zip(found["/cams/0/pose"], poses, strict=True):
        p = message.pose.position
        assert (p.x, p.y, p.z) == pose.pose.position
    jpeg = recording.of(ColorImage)[3].array.tobytes()
    assert found["/cams/0/color"][3][1].data == jpeg
    assert found["/metrics/quality"][0][1]["stamp_true"][1]["coverage"] == 0.5


def test_the_map_is_there_at_every_instant_where_the_mapper_had_it(recording, capsys, tmp_path):
    out = tmp_path / "out.mcap"
    assert export(recording, capsys, "--to", "foxglove", "--out", str(out))[0] == 0
    clouds, mirror = decoded(out)["/map/occupied"], MapMirror()
    assert len(clouds) == NUM_TICKS
    for (t_ns, cloud), changes in zip(clouds, recording.of(MapChanges), strict=True):
        mirror.apply(changes)
        assert (t_ns, cloud.frame_id) == (changes.t_ns, "world")
        assert cloud.point_stride == 16
        points = np.frombuffer(cloud.data, "<f4").reshape(-1, 4)[:, :3]
        np.testing.assert_allclose(points, mirror.centres(), atol=1e-5)
        assert len(points) == recording.occupied[changes.tick]
        p = cloud.pose.position
        assert (p.x, p.y, p.z) == changes.pose.position


def test_the_map_may_go_in_less_often(recording, capsys, tmp_path):
    out = tmp_path / "out.mcap"
    flags = ("--to", "foxglove", "--out", str(out), "--map-every", "0.3", "--pixel-step", "0")
    assert export(recording, capsys, *flags)[0] == 0
    found = decoded(out)
    assert [t_ns // DT_NS for t_ns, _ in found["/map/occupied"]] == [0, 3, 6, 9]
    assert "/cams/0/points" not in found


def ordered(centres):
    """Sort the centres of voxels by their lattice coordinates."""
    return centres[np.lexsort(np.floor(centres / VOXEL_M).T)]


def test_a_ply_has_the_voxels_of_the_instant(recording, capsys, tmp_path):
    for flags, tick in ((("--tick", "4"), 4), (("--at", "0.75"), 7), ((), NUM_TICKS - 1)):
        out = tmp_path / f"{tick}.ply"
        code, said = export(recording, capsys, "--to", "ply", "--out", str(out), *flags)
        assert code == 0, said
        assert f"tick {tick}" in said
        mirror = MapMirror()
        for changes in recording.of(MapChanges)[: tick + 1]:
            mirror.apply(changes)
        stored = formats.read(out)
        assert stored.box.resolution_m == VOXEL_M
        voxels = occupied(stored)
        centres = stored.box.centres_m(voxels.voxel)
        np.testing.assert_allclose(ordered(centres), ordered(mirror.centres()), atol=1e-6)
        heights = centres[:, 2]
        assert len(np.unique(voxels.color[heights > heights.max() - 1e-6], axis=0)) == 1


def test_merged_clouds_are_all_points_of_all_cameras(recording, capsys, tmp_path):
    import trimesh

    out = tmp_path / "cloud.ply"
    flags = ("--to", "ply", "--merged", "--tick", "5", "--out", str(out))
    code, said = export(recording, capsys, *flags)
    assert code == 0, said
    clouds = [each for each in recording.of(DepthCloud) if each.tick == 5]
    expected = np.concatenate([cloud.points_world() for cloud in clouds])
    np.testing.assert_allclose(trimesh.load(out).vertices, expected, atol=1e-5)


def film(recording, capsys, path, *flags):
    code, said = export(
        recording, capsys, "--to", "video", "--out", str(path), "--size", "200x120",
        "--supersample", "1", "--fps", "10", *flags,
    )  # fmt: skip
    assert code == 0, said


@pytest.mark.slow
def test_an_mp4_opens_again(recording, capsys, tmp_path):
    import av

    path = tmp_path / "film.mp4"
    film(recording, capsys, path, "--start", "0.3", "--end", "0.9", "--theme", "dark")
    with av.open(str(path)) as container:
        stream = container.streams.video[0]
        pictures = [frame.to_ndarray(format="rgb24") for frame in container.decode(stream)]
        assert stream.average_rate == 10
    assert len(pictures) == 6
    assert all(picture.shape == (120, 200, 3) for picture in pictures)
    assert all(picture.std() > 10 for picture in pictures)
    assert np.abs(pictures[0].astype(int) - pictures[-1]).mean() > 1  # The view goes around.


@pytest.mark.parametrize("ending", [".gif", ".webp"])
def test_a_loop_opens_again(recording, capsys, tmp_path, ending):
    path = tmp_path / f"film{ending}"
    film(recording, capsys, path, "--speed", "2")
    with Image.open(path) as image:
        assert image.size == (200, 120)
        assert image.n_frames == 6  # 1.1 s at twice the speed.
        assert image.info["loop"] == 0
        spread, duration = [], 0
        for number in range(image.n_frames):
            image.seek(number)
            picture = np.asarray(image.convert("RGB")).astype(int)
            duration += image.info["duration"]
            spread.append(picture.std())
        assert min(spread) > 10
        assert duration == 600


@pytest.mark.parametrize(("ending", "most"), [(".gif", 7), (".webp", 2)])
def test_a_loop_too_large_for_memory_is_refused_before_it_is_drawn(
    recording, capsys, tmp_path, monkeypatch, ending, most
):
    monkeypatch.setattr("services.recorder.export.film_file._MOST_BYTES", 7 * 200 * 120)
    flags = ("--to", "video", "--size", "200x120", "--fps", "10", "--supersample", "1")
    out = tmp_path / f"film{ending}"
    code, said = export(recording, capsys, *flags, "--out", str(out))
    assert code != 0
    assert f"at most {most}): write .mp4" in said
    assert not out.exists()
    film(recording, capsys, tmp_path / "film.mp4")  # As it is drawn: no such bound.


def test_a_picture_is_the_same_each_time_and_shows_the_target_where_it_is(recording):
    from services.recorder.export.film import SHOWN
    from services.recorder.export.framing import framed
    from services.recorder.export.picture import Painter, PictureSettings
    from services.recorder.export.reading import Reading

    with RecordedLog(recording.path) as log:
        moment = next(Reading(log).moments(SHOWN, [0.5]))
    settings = PictureSettings(
        width=240, height=180, supersample=2, view="still", insets=False, caption=False
    )
    bare = settings.model_copy(update={"wedges": False})
    first = Painter(bare, framed(moment)).paint(moment, 0.0).copy()
    painter = Painter(bare, framed(moment))
    np.testing.assert_array_equal(painter.paint(moment, 0.0), first)
    # The highest voxel's pixel has the palette's last colour: yellow, more green than blue.
    T = moment.T_world_map
    centres = apply(T, moment.mirror.centres())
    top = centres[np.argmax(centres[:, 2])] + (0, 0, VOXEL_M / 2)
    x, y, z = apply(np.linalg.inv(painter.T_world_eye), top)
    fx, fy, cx, cy = painter.intrinsics
    u, v = round((fx * x / z + cx) / 2), round((fy * y / z + cy) / 2)
    red, green, blue = first[v, u].astype(int)
    assert green > 100
    assert green > blue + 50
    assert red > blue


@pytest.mark.parametrize(
    ("flags", "words"),
    [
        (("--to", "video", "--fps", "0"), "--fps 0.0: Input should be greater than or equal to 1"),
        (("--to", "video", "--size", "big"), "--size 'big' must be WIDTHxHEIGHT"),
        (("--to", "video", "--start", "3", "--end", "2"), "end 2 s must be after start 3 s"),
        (("--to", "video", "--start", "60"), "start 60 s is after the recording's last instant"),
        (("--to", "video", "--out", "film.avi"), "must end in one of .mp4, .gif, .webp, .png"),
        (("--to", "ply", "--at", "60"), "--at 60 s must be within 0..1.100 s"),
        (("--to", "ply", "--tick", "99"), "--tick 99 was not recorded; there are 0..11"),
        (("--to", "foxglove", "--pixel-step", "-1"), "--pixel-step -1"),
        (("--to", "foxglove", "--out", "x.bag"), "must end in .mcap"),
    ],
)
def test_what_cannot_be_made_is_refused_by_name(
    recording, capsys, monkeypatch, tmp_path, flags, words
):
    monkeypatch.chdir(tmp_path)
    code, said = export(recording, capsys, *flags)
    assert code in (1, 2)
    assert words in said
    assert not list(tmp_path.iterdir())


def test_a_file_that_is_no_recording_is_named(capsys, tmp_path):
    path = tmp_path / "x.mcap"
    path.write_bytes(b"no recording at all")
    for to in ("foxglove", "ply", "video"):
        assert dispatch(["export", str(path), "--to", to]) == 1
        assert "no MCAP file" in capsys.readouterr().err
        assert dispatch(["export", str(tmp_path / "none.mcap"), "--to", to]) == 1
        assert "No such file" in capsys.readouterr().err


def test_of_a_torn_file_goes_over_what_is_left(recording, capsys, tmp_path):
    path, out = tmp_path / "torn.mcap", tmp_path / "out.mcap"
    data = recording.path.read_bytes()
    path.write_bytes(data[: len(data) * 9 // 10])
    code = dispatch(["export", str(path), "--to", "foxglove", "--out", str(out)])
    said = capsys.readouterr()
    assert code == 0, said.err
    assert "torn off" in said.err
    assert 0 < len(decoded(out)["/target/pose"]) < NUM_TICKS


def test_a_recording_without_a_map_says_what_it_has(recording, capsys, tmp_path):
    from services.recorder.log_writer import LogWriter
    from services.runtime.tap import Sample

    path = tmp_path / "poses.mcap"
    writer = LogWriter(path, {})
    with RecordedLog(recording.path) as log:
        for record in log.records(wanted=lambda key: key == "target/pose"):
            writer.write(Sample(record.key, record.payload, record.log_ns, None))
            if writer.num_records == 3:
                writer.write(Sample("target/pose", b"no message", record.log_ns, None))
    writer.close({})
    assert dispatch(["export", str(path), "--to", "ply"]) == 1
    assert "map/changes, which was not recorded; recorded: target/pose" in capsys.readouterr().err
    flags = ["--to", "video", "--size", "160x96", "--out", str(tmp_path / "f.gif")]
    assert dispatch(["export", str(path), *flags]) == 0  # A target alone is a film, too.
    assert "1 messages could not be read" in capsys.readouterr().out


def test_every_instant_has_its_message(recording):
    """The recording is what the other tests take it for."""
    kinds = Counter(type(message).__name__ for _, message in recording.messages)
    assert kinds["MapChanges"] == kinds["TargetPose"] == NUM_TICKS
    assert kinds["DepthCloud"] == NUM_CAMERAS * NUM_TICKS
    assert min(recording.occupied) > 500
    assert len({pose.pose.position for pose in recording.of(TargetPose)}) == NUM_TICKS
