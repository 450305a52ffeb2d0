"""The reader, on a small schema of its own: places, sharing, overrides, and input made to break it."""

from __future__ import annotations

import re
import textwrap
import time
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Literal, Self

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from pydantic import BaseModel, ConfigDict, Field, model_validator

from tradestudy import load
from tradestudy.declarations.part import MistakeAt
from tradestudy.declarations.quantities import Fraction, PositiveLength
from tradestudy.errors import OutOfRangeError, StudyError
from tradestudy.study.document import Annotation, Document
from tradestudy.study.edits import with_values
from tradestudy.study.loading import read
from tradestudy.study.schema.validation import validate
from tradestudy.study.shared_cameras import load_entries

STUDIES = Path(__file__).parents[2] / "studies"
WRONG = Path(__file__).parent / "wrong"

Write = Callable[..., Path]


class Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class Lens(Strict):
    focal_length: PositiveLength | None = Field(default=None, description="How strong it is.")
    power: Fraction = 0.0

    @model_validator(mode="after")
    def _sound(self) -> Self:
        if self.focal_length == 0.001:
            raise MistakeAt(("focal_length",), "too strong")
        if self.focal_length == 0.002:
            first, second = MistakeAt(("focal_length",), "too round"), MistakeAt(("power",), "too weak")
            raise MistakeAt.several([first, second])
        if self.focal_length == 0.003:
            raise OutOfRangeError("this lens", value="3 mm", limit="above 3 mm", remedy="take another")
        return self


class Mono(Strict):
    kind: Literal["mono"]
    lens: Lens = Lens()
    size: tuple[int, int] | Literal["full"] = "full"


class Pair(Strict):
    kind: Literal["pair"]
    lenses: list[Lens]
    baseline: PositiveLength


class Study(Strict):
    title: str
    cameras: dict[str, Annotated[Mono | Pair, Field(discriminator="kind")]]
    distances: list[PositiveLength] | Lens = []
    sweep: dict[str, list[str | int]] = {}


BASE = """\
    title: A study
    cameras:
      eye:
        kind: mono
        lens:
          focal_length: {value: 8 mm, basis: datasheet, note: printed on it}
      two.eyes:
        kind: pair
        lenses:
          - focal_length: 8 mm
          - {focal_length: 9 mm}
        baseline: {value: 65 mm, basis: measured}
    distances: {value: [1 m, 2 m], note: near}
"""


@pytest.fixture
def write(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Write:
    monkeypatch.chdir(tmp_path)

    def to_file(text: str, name: str = "s.yaml") -> Path:
        path = Path(name)
        path.parent.mkdir(exist_ok=True)
        path.write_text(textwrap.dedent(text), encoding="utf-8")
        return path

    return to_file


@pytest.fixture
def base(write: Write) -> Document:
    return read(write(BASE))


def reported(document: Document) -> list[str]:
    with pytest.raises(StudyError) as caught:
        validate(document, Study)
    return [str(problem) for problem in caught.value.problems]


class TestDocument:
    def test_every_reading_of_a_text_tells_its_own_mistakes(self, write: Write) -> None:
        """A text is parsed once, and mistakes that one reader adds do not reach the next."""
        path = write(BASE + "    title: Again\n")
        first, second = (load_entries(path) for _ in range(2))
        first[1].append(first[1][0])
        assert [problem.what for problem in second[1]] == ["duplicate key, first on line 1; remove one of them"]
        write(BASE.replace("A study", "Another study"))
        assert read(path).tree["title"] == "Another study"

    def test_tree_is_plain_and_unwrapped(self, base: Document) -> None:
        assert base.tree == {
            "title": "A study",
            "cameras": {
                "eye": {"kind": "mono", "lens": {"focal_length": "8 mm"}},
                "two.eyes": {
                    "kind": "pair",
                    "lenses": [{"focal_length": "8 mm"}, {"focal_length": "9 mm"}],
                    "baseline": "65 mm",
                },
            },
            "distances": ["1 m", "2 m"],
        }

    def test_places(self, base: Document) -> None:
        assert base.locate("title") == ("s.yaml", 1, 8)
        assert base.locate("eye.lens.focal_length") == ("s.yaml", 6, 29)
        assert base.locate("cameras.eye.lens") == ("s.yaml", 5, 5)
        assert base.locate(("cameras", "two.eyes", "lenses", 1, "focal_length")) == ("s.yaml", 11, 24)
        assert base.locate("two.eyes.baseline") == ("s.yaml", 12, 23)
        assert base.locate_key("two.eyes.baseline") == ("s.yaml", 12, 5)
        assert base.locate("distances.1") == ("s.yaml", 13, 26)
        assert base.locate("eye.lens.nowhere.at.all") == base.locate("eye.lens")
        assert base.locate("") == ("s.yaml", 1, 1)

    def test_annotations_in_order(self, base: Document) -> None:
        assert base.annotations == {
            ("cameras", "eye", "lens", "focal_length"): Annotation(basis="datasheet", note="printed on it"),
            ("cameras", "two.eyes", "baseline"): Annotation(basis="measured"),
            ("distances",): Annotation(note="near"),
        }

    def test_text_as_written(self, base: Document) -> None:
        assert base.text_of("eye.lens.focal_length") == "8 mm"
        assert base.text_of("distances") == "[1 m, 2 m]"
        assert base.text_of(("cameras", "two.eyes", "lenses")) == "[{focal_length: 8 mm}, {focal_length: 9 mm}]"
        with pytest.raises(KeyError, match=r"eye\.power"):
            base.text_of("cameras.eye.power")

    def test_reads_by_the_model(self, base: Document) -> None:
        study = validate(base, Study)
        assert study.distances == [1.0, 2.0]
        assert study.cameras["two.eyes"].baseline == 0.065  # type: ignore[union-attr]

    def test_scalars_of_yaml_1_2(self, write: Write) -> None:
        text = (
            "{a: no, b: 0o17, c: 0x1F, d: 010, e: 1e3, f: .inf, g: ~, h: True, i: '1', j: 12:30:00, k: 2001-01-01, l: }"
        )
        expected = {"a": "no", "b": 15, "c": 31, "d": 10, "e": 1000.0, "f": float("inf"), "g": None, "h": True}
        expected |= {"i": "1", "j": "12:30:00", "k": "2001-01-01", "l": None}
        assert read(write(text)).tree == expected

    def test_an_anchor_stands_for_its_value(self, write: Write) -> None:
        document = read(write("a: &x {b: [1 m]}\nc: *x\n"))
        assert document.tree["c"] == {"b": ["1 m"]}
        assert document.locate("c.b.0") == ("s.yaml", 1, 12)


class TestSharing:
    def test_a_camera_from_its_file_is_overridden_in_place(self, write: Write) -> None:
        write(
            """\
            kind: pair
            lenses: [{focal_length: {value: 8 mm, basis: paper}}]
            baseline: {value: 65 mm, basis: paper}
            """,
            "cameras/two.yaml",
        )
        document = read(write("title: t\ncameras:\n  a: {from: cameras/two.yaml, baseline: 20 mm}\n"))
        assert document.tree["cameras"]["a"] == {
            "kind": "pair",
            "lenses": [{"focal_length": "8 mm"}],
            "baseline": "20 mm",
        }
        assert document.locate("a.lenses.0.focal_length") == ("cameras/two.yaml", 2, 33)
        assert document.locate("a.baseline") == ("s.yaml", 3, 41)
        assert list(document.annotations) == [("cameras", "a", "lenses", 0, "focal_length")]

    def test_like_goes_through_chains_in_any_order(self, write: Write) -> None:
        document = read(
            write(
                """\
                cameras:
                  c: {like: b, size: [3, 4]}
                  b: {like: a, lens: {power: 2 %}}
                  a: {kind: mono, lens: {focal_length: 8 mm}}
                """
            )
        )
        lens = {"focal_length": "8 mm", "power": "2 %"}
        assert document.tree["cameras"]["c"] == {"kind": "mono", "lens": lens, "size": [3, 4]}
        assert document.tree["cameras"]["a"]["lens"] == {"focal_length": "8 mm"}

    def test_null_takes_an_inherited_value_back(self, write: Write) -> None:
        document = read(write("cameras:\n  a: {lens: {power: 2 %, x: 1}}\n  b: {like: a, lens: {power: null}}\n"))
        assert document.tree["cameras"]["b"] == {"lens": {"x": 1}}

    def test_what_is_not_there_cannot_be_taken_back(self, write: Write) -> None:
        document = read(
            write("cameras:\n  a: {lens: {power: 2 %}, x: 1}\n  b: {like: a, lens: {powr: null}, y: null, x: null}\n")
        )
        first, second = (str(problem).partition(":")[2] for problem in document.problems)
        assert re.fullmatch(r"3:23: cameras\.b\.lens\.powr: .*null.* 'powr' .*; nearest: 'power'", first)
        assert re.fullmatch(r"3:36: cameras\.b\.y: .*null.* 'y' .*; known: 'lens', 'x'", second)

    def test_a_forgotten_value_takes_nothing_back(self, write: Write) -> None:
        path = write("title: t\ncameras:\n  a: {kind: mono, lens: {power: 2 %}}\n  b: {like: a, lens: {power: }}\n")
        assert reported(read(path)) == [
            "s.yaml:4:29: cameras.b.lens.power: an empty value is not a quantity; a fraction is expected, such as 2 %"
        ]

    def test_a_broken_camera_is_told_once(self, write: Write) -> None:
        path = write("title: t\ncameras:\n  a: {from: nowhere.yaml}\n  b: {like: a}\n  c: {kind: mono, sice: full}\n")
        assert reported(read(path)) == [
            "s.yaml:3:13: cameras.a.from: 'nowhere.yaml': there is no such file",
            "s.yaml:5:19: cameras.c.sice: unknown key; nearest: 'size'",
        ]

    def test_a_long_chain_is_refused(self, write: Write) -> None:
        links = "".join(f"  c{i}: {{like: c{i + 1}}}\n" for i in range(3000))
        problems = reported(read(write(f"title: t\ncameras:\n{links}  c3000: {{kind: mono}}\n")))
        assert any("more than 50 cameras " in problem for problem in problems)


class TestValuesFromOutside:
    def test_set(self, write: Write) -> None:
        document = read(
            write(BASE),
            [
                "eye.lens.focal_length=12 mm",
                "cameras.two.eyes.lenses.1.focal_length = 4e-3 m",
                "distances=[3 m]",
                "eye.size=[1, 2]",
                "title='a=b'",
            ],
        )
        study = validate(document, Study)
        assert study.cameras["eye"] == Mono(kind="mono", lens=Lens.model_construct(focal_length=0.012), size=(1, 2))
        assert document.tree["cameras"]["two.eyes"]["lenses"][1] == {"focal_length": "4e-3 m"}
        assert (study.distances, study.title) == ([3.0], "a=b")
        assert document.locate("eye.lens.focal_length") == ("--set", 1, 23)
        assert list(document.annotations) == [("cameras", "two.eyes", "baseline")]

    def test_set_changes_the_named_camera_alone(self, write: Write) -> None:
        path = write("title: t\ncameras:\n  a: {kind: mono}\n  b: {like: a}\n")
        assert read(path, ["a.size=[1, 2]"]).tree["cameras"] == {
            "a": {"kind": "mono", "size": [1, 2]},
            "b": {"kind": "mono"},
        }

    def test_cameras_that_keep_a_replaced_value_by_being_like_another_are_known(self, write: Write) -> None:
        path = write(
            """\
            title: t
            cameras:
              a: {kind: mono, lens: {focal_length: 8 mm, power: 2 %}}
              own: {like: a, lens: {power: 3 %}}
              far: {like: own}
              apart: {kind: mono}
            """
        )

        def kept(*overrides: str) -> list[tuple[str, ...]]:
            return [one.kept_by for one in read(path, overrides).overrides]

        assert kept("a.lens.focal_length=9 mm") == [("own", "far")]
        assert kept("a.lens.power=4 %", "own.lens.power=4 %") == [(), ("far",)]
        assert kept("a.lens={power: 4 %}") == [()]  # the focal length stays
        assert kept("a.lens={focal_length: 9 mm}") == [("own", "far")]
        assert kept("a.lens.focal_length=null", "a.size=[1, 2]") == [("own", "far"), ("own", "far")]
        assert kept("own.lens=null") == [("far",)]
        assert kept("apart.size=[1, 2]", "far.size=[1, 2]", "title=x") == [(), (), ()]

    def test_set_null_takes_a_value_back(self, base: Document) -> None:
        changed = with_values(base, {"eye.lens.focal_length": "null"})
        assert changed.tree["cameras"]["eye"]["lens"] == {}
        assert base.tree["cameras"]["eye"]["lens"] == {"focal_length": "8 mm"}

    @pytest.mark.parametrize(
        ("path", "text", "words"),
        [
            ("eye.lens.focal", "null", r"cameras\.eye\.lens\.focal: .*null.* 'focal'"),
            ("eye.lens", "{focal: null}", r"cameras\.eye\.lens\.focal: .*null.* 'focal'"),
            ("nothing.within", "null", r"nothing\.within: .*null.* 'within'"),
            ("title", "#x", r"title: '#x' is a .*comment.*; quote it"),
            ("cameras.new", "{like: eye}", r"cameras\.new\.like: like: .*cannot be set; edit the file"),
            ("cameras", "{new: {from: a.yaml}}", r"cameras\.new\.from: from: .*cannot be set; edit the file"),
        ],
    )
    def test_what_a_value_cannot_do_is_refused(self, base: Document, path: str, text: str, words: str) -> None:
        changed = with_values(base, {path: text})
        assert len(changed.problems) == 1
        assert re.search(words, str(changed.problems[0]))
        assert changed.tree == base.tree or "lens" in path

    def test_what_is_taken_back_once_cannot_be_taken_back_again(self, base: Document) -> None:
        once = with_values(base, {"eye.lens.focal_length": "null"})
        assert not once.problems
        assert with_values(once, {"eye.lens.focal_length": "null"}).problems

    def test_a_comment_in_set_is_refused(self, write: Write) -> None:
        for value in ("Rig #2", "# 2", "'Rig' # 2", "[1, 2] # 2"):
            (said,) = reported(read(write(BASE), [f"title={value}"]))
            comment = value[value.index("#") :]
            assert (
                said
                == f"--set:1:7: title: '{comment}' is a YAML comment; quote it and any text before it if '#' is part "
                "of the value"
            )
        for value, title in (("Rig#2", "Rig#2"), ("'Rig #2'", "Rig #2")):
            assert read(write(BASE), [f"title={value}"]).tree["title"] == title

    @pytest.mark.parametrize(
        ("override", "message"),
        [
            ("eye.lens.focal=3 mm", "1: cameras.eye.lens.focal: unknown key; nearest: 'focal_length'"),
            ("eey.lens.power=3 %", "1: eey: unknown key; nearest: 'eye'"),
            ("cameras.eey.lens.power=3 %", "1: cameras.eey: there is no 'eey'; nearest: 'eye'"),
            ("tittle=x", "1: tittle: unknown key; nearest: 'title'"),
            ("lens.power=3 %", "1: lens: unknown key here; the study has 'cameras.eye.lens'"),
            ("title.x=1", "1: title.x: 'title' is a single value and has no 'x'"),
            ("distances.2=1 m", "1: distances.2: 'distances' is a list; one of the positions 0 to 1 is expected"),
            ("distances.far=1 m", "1: distances.far: 'distances' is a list; one of the positions 0 to 1 is expected"),
            ("distances.1=1", "13: distances.1: '1' has no unit; a length is expected, such as 30.5 mm"),
            (
                "eye.lens.power=",
                "16: cameras.eye.lens.power: an empty value is not a quantity; a fraction is expected, such as 2 %",
            ),
            ("title", "1: 'title' is not of the form path=value, such as scene.wavelength=550 nm"),
            ("=3", "1: '=3' is not of the form path=value, such as scene.wavelength=550 nm"),
            (
                "title=[",
                "8: title: this is not valid YAML: expected the node content, but found '<stream end>' "
                "while parsing a flow node",
            ),
        ],
    )
    def test_mistakes_in_set(self, write: Write, override: str, message: str) -> None:
        assert reported(read(write(BASE), [override])) == [f"--set:1:{message}"]

    def test_a_mistake_without_a_value_has_no_place_for_python(self, write: Write) -> None:
        with pytest.raises(StudyError) as caught:
            load(WRONG / "right.yaml", ["rig.baseline=70 mm", "nothing"])
        assert str(caught.value).startswith("'nothing' is not of the form path=value")
        assert str(caught.value.problems[0]).startswith("--set:2:1: 'nothing'")

    def test_a_value_set_twice_is_refused(self, write: Write) -> None:
        twice = ["title=A", "eye.lens.power=3 %", "cameras.eye.lens.power=4 %"]
        (said,) = reported(read(write(BASE), twice))
        assert said == "--set:3:1: cameras.eye.lens.power: is set twice; omit one of the values"

    def test_what_composes_a_camera_cannot_be_set(self, write: Write) -> None:
        (said,) = reported(read(write(BASE), ["eye.like=two.eyes"]))
        assert re.fullmatch(r"--set:1:1: cameras\.eye\.like: like: .*cannot be set; edit the file.*", said)
        for override in ("eye.length_unit=mm", "eye={pair: [2, 1]}", "eye.pictures=raw", "eye.lens_model=fisheye"):
            (said,) = reported(read(write(BASE), [override]))
            assert "is read with the calibration file and cannot be set; edit the file" in said

    def test_values_are_told_where_they_come_from(self, write: Write) -> None:
        text = textwrap.dedent(BASE) + "sweep: {eye.lens.focal_length: [1 cm, 3]}\n"
        document = read(write(text))
        source = ("sweep", "eye.lens.focal_length", 1)
        path = "eye.lens.focal_length"
        message = "cameras.eye.lens.focal_length: '3' has no unit; a length is expected, such as 30.5 mm"
        assert reported(with_values(document, {path: "3"}, written_at={path: source})) == [f"s.yaml:14:39: {message}"]
        assert reported(with_values(document, {path: "3"})) == [f"--set:1:1: {message}"]


class TestMistakesOfValidators:
    @pytest.mark.parametrize(
        ("value", "messages"),
        [
            ("1 mm", ["s.yaml:3:30: cameras.a.lens.focal_length: too strong"]),
            (
                "2 mm",
                ["s.yaml:3:19: cameras.a.lens.power: too weak", "s.yaml:3:30: cameras.a.lens.focal_length: too round"],
            ),
            ("3 mm", ["s.yaml:3:19: cameras.a.lens: this lens: 3 mm (allowed: above 3 mm); take another"]),
        ],
    )
    def test_point_where_they_say(self, write: Write, value: str, messages: list[str]) -> None:
        text = f"title: t\ncameras:\n  a: {{kind: mono, lens: {{focal_length: {value}}}}}\n"
        assert sorted(reported(read(write(text)))) == sorted(message.replace("3:30", "3:40") for message in messages)

    def test_the_member_of_a_union_that_was_meant_speaks(self, write: Write) -> None:
        text = "title: t\ncameras: {}\ndistances: "
        assert reported(read(write(text + "[1 m, 2]"))) == [
            "s.yaml:3:18: distances.1: '2' has no unit; a length is expected, such as 30.5 mm"
        ]
        assert reported(read(write(text + "{focal: 3 mm}"))) == [
            "s.yaml:3:13: distances.focal: unknown key; nearest: 'focal_length'"
        ]
        expected = "a list or a mapping with keys such as focal_length, power is expected"
        assert reported(read(write(text + "far"))) == [f"s.yaml:3:12: distances: 'far' is given; {expected}"]


def in_time(path: Path) -> list[str]:
    """What is said about a file of at most 1 MB; a file made to exhaust us is refused long before 10 s."""
    begin = time.process_time()
    with pytest.raises(StudyError) as caught:
        validate(read(path), Study)
    assert time.process_time() - begin < 5.0
    return [problem.what for problem in caught.value.problems]


class TestHostileFiles:
    def test_nesting(self, write: Write) -> None:
        for text in ("[" * 500_000, "a: " + "{b: " * 200_000, "- " * 400_000):
            (said,) = in_time(write(text))
            assert "nested more than 32 " in said

    def test_anchors_that_expand_without_bound(self, write: Write) -> None:
        tenfold = ", ".join("*a{0}" for _ in range(10))
        lines = [f"a{i + 1}: &a{i + 1} [{tenfold.format(i)}]" for i in range(20)]
        (said,) = in_time(write("\n".join(["a0: &a0 [lol]", *lines])))
        assert re.search(r"more than 120000 values, .*'\*'", said)

    def test_anchors_that_nest_without_bound(self, write: Write) -> None:
        lines = [f"a{i + 1}: &a{i + 1} [*a{i}]" for i in range(5000)]
        (said,) = in_time(write("\n".join(["a0: &a0 [x]", *lines])))
        assert "nested more than 32 " in said

    def test_anchors_inside_themselves(self, write: Write) -> None:
        said = in_time(write("title: &a [*a]\ncameras: &b {x: {y: *b}}\n"))
        assert any(re.search(r"'\*a' .*'&a'", one) for one in said)
        assert any(re.search(r"'\*b' .*'&b'", one) for one in said)

    def test_cameras_that_multiply(self, write: Write) -> None:
        big = "  big: {x: [" + "1, " * 20_000 + "]}\n"
        copies = "".join(f"  c{i}: {{like: big}}\n" for i in range(2000))
        said = in_time(write(f"title: t\ncameras:\n{big}{copies}"))
        assert any("cameras together" in one and "more than 120000 values" in one for one in said)

    def test_many_mistakes(self, write: Write) -> None:
        assert len(in_time(write("a: 1\n" * 50_000))) == 501
        assert len(in_time(write("".join(f"k{i}: 1\n" for i in range(5_000))))) == 501

    @pytest.mark.parametrize(
        "text",
        [
            "!" * 900_000,
            "'" * 900_000,
            "%YAML 1." + "1" * 9000,
            "&a *a",
            "? ? ?",
            '"\\ud800": "\\udfff"',
            "a: '\\xZZ'",
            '"\\U99999999"',
        ],
    )
    def test_what_parsers_trip_over(self, write: Write, text: str) -> None:
        assert in_time(write(text))


FRAGMENTS = [
    b": ", b"- ", b"[", b"]", b"{", b"}", b"&a ", b"*a", b"!!str ", b"\t", b"\n", b"\n  ", b"'", b'"', b"|", b"? ",
    b"<<: ", b"#", b"---\n", b"\0", b"\xff", b"\xe2\x80\xa8", b"null", b"true", b".inf", b".nan", b"-1", b"0", b"1e999",
    b"9" * 40, b'"\\uD800"', b"mm", b"%YAML 1.2\n", b"from: ", b"like: ", b"value: ", b"basis: ", b"infinity",
    b"1e-320 m", b"1e300 m",
]  # fmt: skip
SEEDS = [
    (WRONG / "right.yaml").read_bytes(),
    (STUDIES / "plenoptic_vs_stereo.yaml")
    .read_bytes()
    .replace(b"raytrix-r5.yaml", b"plenoptic.yaml")
    .replace(b"stereo-100mm.yaml", b"rig.yaml"),
]


@st.composite
def mutated(draw: st.DrawFn) -> bytes:
    content = draw(st.sampled_from(SEEDS))
    for _ in range(draw(st.integers(1, 4))):
        start = draw(st.integers(0, len(content)))
        end = start + draw(st.sampled_from([0, 0, 1, 5, 20]))
        content = content[:start] + draw(st.sampled_from([*FRAGMENTS, b"", content[end : end + 100]])) + content[end:]
    return content


@given(content=mutated())
@settings(max_examples=50, derandomize=True, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_a_mutated_study_is_valid_or_refused_with_a_reason(content: bytes, tmp_path: Path) -> None:
    study = tmp_path / "study.yaml"
    if not (tmp_path / "cameras").exists():
        (tmp_path / "cameras").symlink_to(WRONG / "cameras")
    study.write_bytes(content)
    try:
        load(study)
    except StudyError as error:
        assert all(problem.line >= 1 and problem.column >= 1 and problem.what for problem in error.problems)  # noqa: PT017
