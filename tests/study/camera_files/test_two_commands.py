"""From a calibration file to a report in two commands."""

from __future__ import annotations

import errno
import re
from pathlib import Path

import pytest
from typer.testing import CliRunner

import tradestudy
from tests.study.camera_files import written
from tradestudy.cli import app

pytestmark = pytest.mark.usefixtures("empty_figures")


def test_two_commands_lead_from_an_opencv_file_to_a_report(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    written.opencv(tmp_path / "stereo.yml")
    monkeypatch.chdir(tmp_path)
    runner = CliRunner()
    made = runner.invoke(app, ["new", "my-rig", "--from", "stereo.yml", "--set", "length_unit=mm"])
    assert made.exit_code == 0, made.output
    ran = runner.invoke(app, ["run", "my-rig.yaml", "--no-pdf"])
    assert ran.exit_code == 0, ran.output
    assert "read: rig: stereo.yml: OpenCV FileStorage\n" in ran.output
    assert "\n  lens model pinhole with k1 k2; field of view " in ran.output
    assert "; length unit mm, by length_unit of the study\n" in ran.output
    # The pictures overlap by 60 % from B f / (0.4 W) = 0.2 m on.
    assert re.search(r"Met: 2 % from 0\.2\d m to 0\.4\d m, by rig", ran.output)
    assert re.search(
        r"Up to which distance, from 0\.2\d m on, does the camera measure .* met up to [\d.]+ m", ran.output
    )
    assert (tmp_path / "reports" / "my-rig" / "report.html").is_file()
    exported = runner.invoke(app, ["export", "my-rig.yaml", "rig", "--format", "kalibr"])
    assert exported.exit_code == 0, exported.output
    assert (tmp_path / "reports" / "my-rig" / "cameras" / "rig-camchain.yaml").is_file()


def test_a_study_that_cannot_run_is_not_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    written.opencv(tmp_path / "stereo.yml")
    monkeypatch.chdir(tmp_path)
    made = CliRunner().invoke(app, ["new", "my-rig", "--from", "stereo.yml"])
    assert made.exit_code == 2
    assert "length_unit: mm" in made.output
    assert "my-rig.yaml was not written" in made.output
    assert "--set length_unit=mm" in made.output
    assert not (tmp_path / "my-rig.yaml").exists()


def test_a_file_of_another_program_is_not_mistaken_for_a_camera(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "robot.yml").write_text("joints: [1.0, 2.0]\n")
    monkeypatch.chdir(tmp_path)
    made = CliRunner().invoke(app, ["new", "my-rig", "--from", "robot.yml"])
    assert made.exit_code == 2
    assert "'robot.yml' is neither a camera nor a calibration file" in made.output


def test_everything_that_a_file_lacks_is_reported_at_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whatever the unit of the file is."""
    monkeypatch.chdir(tmp_path)
    for unit, name in ((1.0, "metres"), (1e2, "centimetres"), (1e3, "millimetres")):
        written.opencv(tmp_path / f"{name}.yml", size=None, lengths=unit)
        made = CliRunner().invoke(app, ["new", "my-rig", "--from", f"{name}.yml"])
        assert made.exit_code == 2
        assert "does not state its unit of length" in made.output
        assert "sensor.pixels: this key is missing" in made.output
        assert len(made.output.strip().splitlines()) == 3  # two mistakes and the advice


def test_a_mistyped_unit_of_length_is_named_with_the_missing_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    written.opencv(tmp_path / "stereo.yml")
    monkeypatch.chdir(tmp_path)
    made = CliRunner().invoke(app, ["new", "my-rig", "--from", "stereo.yml", "--set", "lenght_unit=mm"])
    assert made.exit_code == 2
    assert "cameras.rig.lenght_unit: unknown key; nearest: 'length_unit'" in made.output
    assert "does not state its unit of length" in made.output
    known = CliRunner().invoke(app, ["new", "my-rig", "--from", "stereo.yml", "--set", "title=Rig"])
    assert "unknown key" not in known.output


@pytest.mark.parametrize(
    ("name", "content", "cause"),
    [
        ("broken.yaml", "camera_matrix: {rows: 3\ncols: [", "broken.yaml:2:5: "),
        ("broken.json", '{"a": [1,', "broken.json:1:10: "),
        ("words.txt", "hello", "words.txt:1:1: cameras.rig: "),
        ("study.yaml", "format: 2\nstudy: a\ncameras: {near: {kind: stereo}}", "'study.yaml' is a study"),
        ("empty.yaml", "", "cameras.rig.from: 'empty.yaml' is empty; a camera or a calibration file ("),
        ("absent.yaml", None, "cameras.rig.from: 'absent.yaml'"),
    ],
)
def test_the_cause_comes_before_the_advice(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, content: str | None, cause: str
) -> None:
    monkeypatch.chdir(tmp_path)
    if content is not None:
        (tmp_path / name).write_text(content)
    made = CliRunner().invoke(app, ["new", "my-rig", "--from", name])
    assert made.exit_code == 2
    first, *_, advice = made.output.strip().splitlines()
    assert cause in first
    assert "--set" in advice
    assert "my-rig.yaml:" not in made.output  # that file does not exist


def test_two_files_in_one_argument_are_refused_with_how_to_give_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    written.camchain(tmp_path / "left.yaml")
    written.camchain(tmp_path / "right.yaml")
    monkeypatch.chdir(tmp_path)
    for files in (["left.yaml", "right.yaml"], ["left.yaml right.yaml"]):
        made = CliRunner().invoke(app, ["new", "my-rig", "--from", *files])
        assert made.exit_code == 2
        assert "--from left.yaml --from right.yaml" in made.output
        assert not (tmp_path / "my-rig.yaml").exists()


def test_one_file_of_two_is_reported_as_one_camera(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    left, _ = written.camera_info_pair(tmp_path)
    monkeypatch.chdir(tmp_path)
    asked = ["new", "half", "--from", left.name]
    refused = CliRunner().invoke(app, asked)
    assert refused.exit_code == 2
    assert "cameras.rig.from: " in refused.output
    assert "from: [LEFT, RIGHT]" in refused.output
    made = CliRunner().invoke(app, [*asked, "--set", "sensor.pixel_pitch=3 um", "--set", "focus={distance: 1 m}"])
    assert made.exit_code == 0, made.output
    assert "from: [LEFT, RIGHT]" in made.output


def test_a_missing_picture_size_is_reported_too(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    written.opencv(tmp_path / "stereo.yml", size=None)
    monkeypatch.chdir(tmp_path)
    asked = ["new", "my-rig", "--from", "stereo.yml", "--set", "length_unit=mm"]
    refused = CliRunner().invoke(app, asked)
    assert refused.exit_code == 2
    assert "sensor.pixels: this key is missing" in refused.output
    made = CliRunner().invoke(app, [*asked, "--set", "sensor.pixels=[640, 480]"])
    assert made.exit_code == 0, made.output


def test_several_parts_of_one_key_are_set_together(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    written.opencv(tmp_path / "stereo.yml", size=None)
    monkeypatch.chdir(tmp_path)
    asked = ["new", "my-rig", "--from", "stereo.yml", "--set", "length_unit=mm", "--set", "sensor.pixels=[640, 480]"]
    for key in ("sensor.pixels", "sensor", "sensor.pixels.columns"):
        twice = CliRunner().invoke(app, [*asked, "--set", f"{key}=1"])
        assert twice.exit_code == 2
        assert twice.output == f"--set gives this key, or a part of it, twice: {key}; omit one\n"
    commented = CliRunner().invoke(app, [*asked, "--set", "title=Rig #2"])
    assert commented.exit_code == 2
    assert commented.output.startswith("this part of a value is a YAML comment: '#2'; quote the whole value")
    made = CliRunner().invoke(app, [*asked, "--set", "sensor.pixel_pitch=3.45 um", "--set", "title='Rig #2'"])
    assert made.exit_code == 0, made.output
    assert tradestudy.load(tmp_path / "my-rig.yaml").file.cameras["rig"].title == "Rig #2"
    sensor = tradestudy.load(tmp_path / "my-rig.yaml").definition.designs["rig"].sensor
    assert (sensor.columns, sensor.rows, sensor.pixel_pitch) == (640, 480, pytest.approx(3.45e-6))


def test_a_place_that_cannot_be_written_to_is_reported_in_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    written.camchain(tmp_path / "chain.yaml")
    path = written.study(tmp_path, rig="from: chain.yaml")
    (tmp_path / "plain").write_text("a file")
    for command in ("run", "export"):
        asked = [command, str(path), *(["rig"] if command == "export" else []), "--out", str(tmp_path / "plain")]
        ended = CliRunner().invoke(app, asked)
        assert ended.exit_code == 2, ended.output
        assert re.search(rf"{tmp_path}/plain\S* cannot be read or written", ended.output)
        assert "give another output folder" in ended.output
        assert "unexpected" not in ended.output

    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device", str(tmp_path / "x"))

    monkeypatch.setattr("tradestudy.results.storage.replace_file", full)
    ended = CliRunner().invoke(app, ["export", str(path), "rig", "--out", str(tmp_path / "out")])
    assert ended.exit_code == 1
    assert re.search(r"x cannot be read or written: No space left on device; .*run again", ended.output)
