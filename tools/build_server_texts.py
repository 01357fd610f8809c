"""Collects the sentences of the server that a person reads into the catalogs of the page's other languages.

They stay English in the API and in the journal; the page in another language looks them up as it shows them
(`web/src/api/server-text.ts`). A sentence with values is a template: `Vehicle {0} is not armed.`

Run: `make texts`. The test `tests/unit/tools/test_server_texts.py` fails if a catalog is out of date.
"""

from __future__ import annotations

import ast
import itertools
import json
import re
import sys
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
LOCALES = ROOT / "web" / "locales"
LANGUAGES = ("de",)
TITLES = ROOT / "vehicle_sim" / "data" / "parameter_titles.json"
"""What parameters are for, in the words of the simulated vehicle."""

AREAS: tuple[tuple[str, re.Pattern[str]], ...] = (
    ("server-missions", re.compile(r"missions/")),
    ("server-vehicle", re.compile(r"gcs_server/(vehicle|mavlink|links|ros2|px4_sitl)/")),
    ("server-flight", re.compile(r"gcs_server/(streamer|control|flights|plans|operations|telemetry)/")),
    ("server", re.compile(r"gcs_server/")),
)
"""Catalog by path; a sentence that several have is in the first."""
SILENT_FILES = re.compile(
    r"/agents/(answers|bridge|documents|own_tools|protocol|tools)\.py|"
    r"/(client|examples|generated_\w+|reference|sign_in|scenarios|scene)/|/(cli|__main__|key_command|doctor|schema|sign_in_page|described|settings|"
    r"generated_dialect|palette|shapes|encodings|http_protocol|parser)\.py$|"
    r"/(exports/(foxglove|json_messages|sink|tracks)|ros2_layout)\.py$"
)
"""Command lines, the Python client, descriptions of the API, what only agents read, files for others: the
page shows none."""
SILENT_CALLS = re.compile(
    r"Field|Query|Path|Body|Header|compile|add_argument|debug|info|warning|exception|"
    r"critical|log|startswith|endswith|split|rsplit|removeprefix|"
    r"removesuffix|replace|index|find|partition|encode|hasattr|setattr|TypeVar|"
    r"Literal|NewType|struct|Struct|unpack|pack|AssertionError|SystemExit|RuntimeError|"
    r"TypeError|IndexError|KeyError|Thread|Event|create_task|APIRouter|strftime|"
    r"isinstance|cast|open|getLogger|print|MAVError|WebSocketException"
)
SILENT_KEYWORDS = re.compile(
    r"description|summary|tags|responses|examples|alias|pattern|name|key|code|kind|"
    r"mode|encoding|pointer"
)
MAX_VARIANTS = 8
WORD = re.compile(r"[^\W\d_][a-z’']")
MACHINE = re.compile(
    r"^[\w./-]*[/_=][\w./=-]*$|^[A-Z][A-Z0-9_]+$|^</?\w|^(GET|POST|PUT|DELETE|WS) /|^--|^/\?|^\S*://\S*$|%s|"
    r"; Secure|Path=/|^(CREATE|PRAGMA|SELECT|INSERT|UPDATE|DROP|ALTER|BEGIN|VACUUM|ATTACH|WITH) |"
    r"^\{\d+\}[\s:.,;/–-]*$|^[a-z0-9-]+\.[a-z]+$"
)
"""Routes, options, addresses, SQL, formats of the log."""
DESCRIBED = re.compile(r"gcs_server/api/\w*(routes|models|setpoints|responses|documents)\.py$")
"""Modules whose texts outside functions describe the API."""
NAME = re.compile(r"^[A-Z][a-z]+(?:-[a-z]+)?$")
SHOWN_KEYWORDS = re.compile(
    r"title|label|text|reason|why|detail|message|remedy|progress|note|warning|unit_text"
)


@dataclass
class Texts(ast.NodeVisitor):
    """The shown sentences of one module."""

    found: dict[str, int] = field(default_factory=dict[str, int])
    """Line by sentence."""
    inside_text: bool = False
    described: bool = False
    """Whether texts outside functions describe the API."""

    def add(self, text: str, line: int, *, shown: bool = False) -> None:
        """Keeps a text that is a sentence, a part of one, or a name that is shown."""
        words = re.sub(r"\{\d+\}", " # ", text)
        if not WORD.search(words) or MACHINE.search(text.strip()):
            return
        is_sentence = " " in text.strip() or (text != text.strip() and text.strip().isalpha())
        is_word = re.fullmatch(r"[A-Za-z’'-]+[….:?!]?", text) is not None
        if is_sentence or (is_word and (shown or self.inside_text or NAME.match(text))):
            self.found.setdefault(text, line)

    def visit_Module(self, node: ast.Module) -> None:
        self._body(node)

    def visit_ClassDef(self, node: ast.ClassDef) -> None:
        self._body(node)

    def visit_FunctionDef(self, node: ast.FunctionDef) -> None:
        self._body(node)

    def visit_AsyncFunctionDef(self, node: ast.AsyncFunctionDef) -> None:
        self._body(node)

    def _body(self, node: ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef) -> None:
        outer, self.inside_text = self.inside_text, False
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            for default in (*node.args.defaults, *node.args.kw_defaults):
                if default is not None:
                    self.visit(default)
        only_functions = self.described and not isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
        for statement in node.body:
            if not only_functions or isinstance(
                statement, ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef
            ):
                self.visit(statement)
        self.inside_text = outer

    def visit_Expr(self, node: ast.Expr) -> None:
        if not isinstance(node.value, ast.Constant):  # else a docstring
            self.visit(node.value)

    def visit_AnnAssign(self, node: ast.AnnAssign) -> None:
        if node.value is not None:
            self.visit(node.value)

    def visit_Compare(self, node: ast.Compare) -> None:
        for part in (node.left, *node.comparators):
            if not isinstance(part, ast.Constant | ast.Tuple | ast.Set | ast.List):
                self.visit(part)

    def visit_Subscript(self, node: ast.Subscript) -> None:
        self.visit(node.value)

    def visit_match_case(self, node: ast.match_case) -> None:
        for statement in node.body:
            self.visit(statement)

    def visit_Dict(self, node: ast.Dict) -> None:
        for value in node.values:
            self.visit(value)

    def visit_Call(self, node: ast.Call) -> None:
        if isinstance(node.func, ast.Attribute) and getattr(node.func.value, "id", "") in ("log", "logger"):
            return
        name = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
        self.visit(node.func)
        if SILENT_CALLS.fullmatch(name):
            return
        for argument in node.args[1 if name in ("get", "pop", "setdefault", "getattr") else 0 :]:
            self.visit(argument)
        for keyword in node.keywords:
            if SILENT_KEYWORDS.fullmatch(keyword.arg or ""):
                continue
            if SHOWN_KEYWORDS.fullmatch(keyword.arg or "") and isinstance(keyword.value, ast.Constant):
                if isinstance(keyword.value.value, str):
                    self.add(keyword.value.value, keyword.value.lineno, shown=True)
            else:
                self.visit(keyword.value)

    def visit_Constant(self, node: ast.Constant) -> None:
        if isinstance(node.value, str):
            self.add(node.value, node.lineno)

    def visit_JoinedStr(self, node: ast.JoinedStr) -> None:
        for text in sentences(node):
            self.add(text, node.lineno)
        outer, self.inside_text = self.inside_text, True
        for part in node.values:
            if isinstance(part, ast.FormattedValue) and choice(part) is None:
                self.visit(part.value)
        self.inside_text = outer


def choice(part: ast.FormattedValue) -> tuple[str, str] | None:
    """The two texts of a hole that chooses between them: `{'s' if many else ''}`."""
    value = part.value
    if (
        isinstance(value, ast.IfExp)
        and isinstance(value.body, ast.Constant)
        and isinstance(value.orelse, ast.Constant)
    ):
        both = value.body.value, value.orelse.value
        if isinstance(both[0], str) and isinstance(both[1], str):
            return both[0], both[1]
    return None


def sentences(node: ast.JoinedStr) -> Iterator[str]:
    """The sentence with numbered holes; one for each choice of words that it has."""
    parts: list[tuple[str | None, ...]] = []
    for part in node.values:
        if isinstance(part, ast.Constant):
            parts.append((str(part.value),))
        else:
            assert isinstance(part, ast.FormattedValue)
            parts.append(choice(part) or (None,))
    variants = list(itertools.islice(itertools.product(*parts), MAX_VARIANTS + 1))
    if len(variants) > MAX_VARIANTS:
        variants = [tuple(part[0] if len(part) == 1 else None for part in parts)]
    for variant in variants:
        number = itertools.count()
        yield "".join(f"{{{next(number)}}}" if piece is None else piece for piece in variant)


def collect() -> dict[str, dict[str, list[str]]]:
    """The files of each sentence, by catalog, in the order of the files."""
    areas: dict[str, dict[str, list[str]]] = {name: {} for name, _ in AREAS}
    home: dict[str, str] = {}
    for path in sorted([*(ROOT / "missions").rglob("*.py"), *(ROOT / "gcs_server").rglob("*.py")]):
        file = path.relative_to(ROOT).as_posix()
        if SILENT_FILES.search(file):
            continue
        texts = Texts(described=DESCRIBED.search(file) is not None)
        texts.visit(ast.parse(path.read_text("utf-8")))
        area = next(name for name, paths in AREAS if paths.match(file))
        for text in sorted(texts.found, key=lambda text: texts.found[text]):
            areas[home.setdefault(text, area)].setdefault(text, []).append(file)
    titles = json.loads(TITLES.read_text("utf-8"))
    areas["server-parameters"] = {title: [TITLES.relative_to(ROOT).as_posix()] for title in titles.values()}
    return areas


def quoted(text: str) -> str:
    """A text as gettext writes it."""
    return '"' + text.replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n") + '"'


def catalog(language: str, entries: dict[str, list[str]], known: dict[str, str]) -> str:
    """A catalog as text, with the translations that exist."""
    fields = (f"Language: {language}\n", "MIME-Version: 1.0\n", "Content-Type: text/plain; charset=utf-8\n")
    blocks = ["\n".join(['msgid ""', 'msgstr ""', *map(quoted, fields)])]
    for text, files in entries.items():
        references = "".join(f"#: {file}\n" for file in files)
        blocks.append(f"{references}msgid {quoted(text)}\nmsgstr {quoted(known.get(text, ''))}")
    return "\n\n".join(blocks) + "\n"


ENTRY = re.compile(r'^msgid ((?:".*"\n?)+)msgstr ((?:".*"\n?)+)', re.MULTILINE)


def read_catalog(text: str) -> dict[str, str]:
    """The translations of a catalog, also as an editor for such files has folded and escaped them."""
    entries = [
        [str(ast.literal_eval(f"({part.strip()})")) for part in match] for match in ENTRY.findall(text)
    ]
    return {source: words for source, words in entries if source and words}


def translations(language: str) -> dict[str, str]:
    """The translations of all server catalogs of a language."""
    files = sorted((LOCALES / language).glob("server*.po"))
    return {text: words for file in files for text, words in read_catalog(file.read_text("utf-8")).items()}


def catalogs(language: str) -> dict[Path, str]:
    """Each catalog's file and text as they should be."""
    known = translations(language)
    return {
        LOCALES / language / f"{name}.po": catalog(language, entries, known) + "\n"
        for name, entries in collect().items()
    }


def main() -> None:
    """Writes the catalogs; prints the translations that no sentence needs any more."""
    used = {text for entries in collect().values() for text in entries}
    for language in LANGUAGES:
        for text, words in translations(language).items():
            if text not in used:
                print(f"no longer used: “{text}” = “{words}”", file=sys.stderr)
        for file, text in catalogs(language).items():
            file.write_text(text, "utf-8")


if __name__ == "__main__":
    main()
