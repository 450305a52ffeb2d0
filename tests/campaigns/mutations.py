"""Mutations of study files: bytes, lines, tokens, values, structure, splices of two files, hostile YAML, overrides."""

from __future__ import annotations

import random
import re
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from tradestudy.study.starter import starter
from tradestudy.verification.study_files import study

STUDIES = Path(__file__).parents[2] / "studies"
TOKEN = re.compile(r"[^\s{}\[\],:]+")

NASTY_VALUES = (
    *(
        "0",
        "-1",
        "1e308 m",
        "1e-400 m",
        "-0.0 mm",
        ".nan",
        ".inf m",
        "9" * 400,
        "1e999999999 um",
        "0x10 m",
        "null",
        "~",
    ),
    *(
        "''",
        '"\\u0000"',
        '"\\ud800"',
        '"\\x1b[31m"',
        "yes",
        "no",
        "12:30:45",
        "2020-01-01",
        "1_000 mm",
        "1,5 mm",
        "٣ m",
    ),
    *("5 um um", "1 kg", "3 px/mm", "1 furlong", "1 m**99", "m", "%", "1 %%", "- 1 m", "+1 m", "1 m # no", "*", "&a"),
    *("!!python/name:os.system", "!!binary aGk=", "<<", "..", "../..", "/etc/passwd", "~root", "file:///etc/passwd"),
    *("{}", "[]", "[[]]", "{a: {a: {a: 1}}}", "[1 m, 1 m]", "[2 m, 1 m]", "𝟙 m", "\u202e1 m", "1\u00a0m", "ß" * 300),
    *("{value: 1 m, basis: assumed}", "{value: 1 m, basis: guess}", "{value: [1 m, 2 m], basis: paper, note: n}"),
    *("{from: 1 m, to: 2 m, points: 3}", "{from: 1 m, to: 1 m, points: 1000000000}", "1e-300 m", "1e300 m"),
)
NASTY_LINES = (
    *("---", "...", "%YAML 1.1", "%TAG ! tag:x,2000:", "\tstudy: tab", "? [a, b]\n: c", "- loose", "key without colon"),
    *(
        "<<: *nothing",
        "a: &a [*a]",
        "b: &b {c: *b}",
        "? ? ?",
        "!!set {a, b}",
        "|\n  text",
        ">+\n\n\n",
        '"open',
        "'open",
    ),
    *("{a: b", "[a, b", "}}", "]]", "\ufeff", "\x00", "\x07", "\ud7ff", "# comment only", "study: twice", "a" * 5000),
    "x: " + "[" * 200,
    "x: " + "{a: " * 200,
    "y: &y [l, l, l, l, l, l, l, l, l]\nz: &z [*y, *y, *y, *y, *y, *y]\nw: [*z, *z, *z, *z]",
    "-" * 300,
    "? " * 300,
    "&a " * 3,
    "&" + "a" * 2000 + " x: 1",
    "!" + "t" * 900 + " x: 1",
)


@dataclass(frozen=True, kw_only=True)
class Corpus:
    """Studies to begin with, how often each is taken, and every word that occurs in them."""

    folder: Path
    texts: tuple[str, ...]
    weights: tuple[float, ...]
    words: tuple[str, ...]

    @classmethod
    def shipped(cls, folder: Path) -> Corpus:
        """The studies of the repository, the starter and a small one, in a folder with the cameras they use."""
        shutil.copytree(STUDIES / "cameras", folder / "cameras")
        shutil.copytree(STUDIES / "data", folder / "data")
        shipped = {path.name: path.read_text(encoding="utf-8") for path in sorted(STUDIES.glob("*.yaml"))}
        texts = (starter("fuzz"), study(), *shipped.values())
        # Large studies take a second each; small ones find as much, sooner.
        weights = (30.0, 30.0, *(max(0.5, 20.0 * min(1.0, (1500 / len(text)) ** 2)) for text in shipped.values()))
        cameras = [path.read_text(encoding="utf-8") for path in (folder / "cameras").glob("*.yaml")]
        words = sorted({word for text in (*texts, *cameras) for word in TOKEN.findall(text)})
        return cls(folder=folder, texts=texts, weights=weights, words=tuple(words))

    def own_files(self) -> set[Path]:
        """What the corpus itself has put into its folder."""
        return {path for name in ("cameras", "data") for path in (self.folder / name).rglob("*")}

    def choose(self, rng: random.Random) -> str:
        return rng.choices(self.texts, self.weights)[0]


def mutated(corpus: Corpus, rng: random.Random) -> tuple[bytes, tuple[str, ...]]:
    """A study with one to four mutations, sometimes of its bytes too, and sometimes with overrides."""
    text = corpus.choose(rng)
    for _ in range(rng.choice((1, 1, 1, 2, 2, 3, 4))):
        text = rng.choice(_MUTATIONS)(text, corpus, rng)
    content = text.encode("utf-8", errors="surrogatepass")
    if rng.random() < 0.1:
        content = _bytes(content, rng)
    overrides = tuple(_override(corpus, rng) for _ in range(rng.choice((0,) * 8 + (1, 2))))
    return content, overrides


def _override(corpus: Corpus, rng: random.Random) -> str:
    """A `--set` argument, mostly of known keys."""
    keys = [word for word in corpus.words if word.replace("_", "").replace("-", "").isalpha()]
    path = ".".join(rng.choices(keys, k=rng.randint(1, 4)))
    return rng.choice((f"{path}={rng.choice(NASTY_VALUES)}", path, f"={path}", f"{path}=", f"..{path}=1 m"))


def _bytes(content: bytes, rng: random.Random) -> bytes:
    data = bytearray(content)
    for _ in range(rng.randint(1, 5)):
        if data:
            data[rng.randrange(len(data))] = rng.randrange(256)
    return bytes(data)


def _cut(text: str, _corpus: Corpus, rng: random.Random) -> str:
    """Leave a stretch out."""
    a, b = sorted(rng.randrange(len(text) + 1) for _ in range(2))
    return text[:a] + text[min(b, a + rng.choice((1, 5, 50, len(text)))) :]


def _insert_letter(text: str, _corpus: Corpus, rng: random.Random) -> str:
    place = rng.randrange(len(text) + 1)
    letters = "{}[]:,&*!|>'\"%@`#-?\t\n\r \\~=0aé\u2028\ufeff\U0001f4f7"
    return text[:place] + rng.choice(letters) * rng.choice((1, 1, 2, 40)) + text[place:]


def _lines(text: str, corpus: Corpus, rng: random.Random) -> str:
    """Drop, double, swap, indent or empty a line, or put a hostile one in."""
    lines = text.split("\n")
    i, j = (rng.randrange(len(lines)) for _ in range(2))
    kind = rng.randrange(7)
    if kind == 0:
        del lines[i]
    elif kind == 1:
        lines.insert(j, lines[i])
    elif kind == 2:
        lines[i], lines[j] = lines[j], lines[i]
    elif kind == 3:
        lines[i] = " " * rng.randint(1, 9) + lines[i]
    elif kind == 4:
        lines[i] = lines[i].lstrip()
    elif kind == 5:
        lines[i] = lines[i].partition(":")[0] + ":"
    else:
        indent = " " * rng.choice((0, 2, 4))
        lines.insert(i, indent + rng.choice(NASTY_LINES))
    return "\n".join(lines)


def _token(text: str, corpus: Corpus, rng: random.Random) -> str:
    """Put another word of the studies, or a hostile value, in the place of a word."""
    found = list(TOKEN.finditer(text))
    if not found:
        return text
    match = rng.choice(found)
    other = rng.choice(corpus.words if rng.random() < 0.5 else NASTY_VALUES)
    return text[: match.start()] + other + text[match.end() :]


def _value(text: str, corpus: Corpus, rng: random.Random) -> str:
    """Put another value behind a key."""
    found = list(re.finditer(r"(?<=: )[^,\n{}\[\]]+", text))
    if not found:
        return text
    match = rng.choice(found)
    other = rng.choice(NASTY_VALUES) if rng.random() < 0.7 else rng.choice(found).group()
    return text[: match.start()] + other + text[match.end() :]


def _number(text: str, _corpus: Corpus, rng: random.Random) -> str:
    """Scale a number, change its sign, or give it many digits."""
    found = list(re.finditer(r"\d+(?:\.\d+)?", text))
    if not found:
        return text
    match = rng.choice(found)
    value = float(match.group())
    other = rng.choice(
        (f"{value * 10.0 ** rng.randint(-30, 30):g}", f"-{match.group()}", f"{value:.60f}", "0", f"{value:e}", "1" * 50)
    )
    return text[: match.start()] + other + text[match.end() :]


def _splice(text: str, corpus: Corpus, rng: random.Random) -> str:
    """Join the beginning of one study and the end of another."""
    other = corpus.choose(rng)
    return text[: rng.randrange(len(text) + 1)] + other[rng.randrange(len(other) + 1) :]


def _repeat(text: str, _corpus: Corpus, rng: random.Random) -> str:
    """Repeat a stretch, now and then until the file is large."""
    a = rng.randrange(len(text) + 1)
    stretch = text[a : a + rng.randint(1, 60)]
    return text[:a] + stretch * rng.choice((2, 3, 10, 10, 100, 2000 if rng.random() < 0.1 else 5)) + text[a:]


def _case(text: str, _corpus: Corpus, rng: random.Random) -> str:
    """Change the case of a word, or its dashes."""
    found = list(TOKEN.finditer(text))
    if not found:
        return text
    match = rng.choice(found)
    word = match.group()
    other = rng.choice(
        (word.upper(), word.title(), word.replace("-", "_"), word.replace("_", "-"), word[::-1], word[1:])
    )
    return text[: match.start()] + other + text[match.end() :]


_MUTATIONS: tuple[Callable[[str, Corpus, random.Random], str], ...] = (
    *(_cut, _insert_letter, _lines, _lines, _token, _token, _value, _value, _number, _number),
    *(_splice, _repeat, _case),
)
