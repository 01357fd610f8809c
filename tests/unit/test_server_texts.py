"""The catalogs of the server's sentences: complete, and of sentences alone."""

import ast
import re

import pytest

from tools.build_server_texts import LANGUAGES, Texts, catalogs, quoted, read_catalog, translations

HOLES = re.compile(r"\{\d+\}")


def texts_of(source: str) -> list[str]:
    texts = Texts()
    texts.visit(ast.parse(source))
    return list(texts.found)


@pytest.mark.parametrize("language", LANGUAGES)
def test_the_catalogs_are_those_of_the_sources(language: str) -> None:
    outdated = [
        file.name
        for file, text in catalogs(language).items()
        if not file.exists() or read_ids(file.read_text("utf-8")) != read_ids(text)
    ]
    assert not outdated, "run `make texts`"


def read_ids(catalog: str) -> list[str]:
    """The sentences of a catalog and where they are from, without their translations."""
    return re.findall(r"^#: .*|^msgid .*", catalog, re.MULTILINE)


@pytest.mark.parametrize("language", LANGUAGES)
def test_a_translation_has_the_holes_of_its_sentence_and_no_other(language: str) -> None:
    for text, words in translations(language).items():
        assert set(HOLES.findall(words)) <= set(HOLES.findall(text)), text


def test_a_sentence_with_values_is_a_template() -> None:
    source = 'raise Refused(f"Vehicle {v.id} is not armed.", remedy="Arm it first.")'
    assert texts_of(source) == ["Vehicle {0} is not armed.", "Arm it first."]


def test_each_choice_of_words_is_a_sentence_of_its_own() -> None:
    source = '''text = f"{n} item{'' if n == 1 else 's'} left"'''
    assert texts_of(source) == ["{0} item left", "{0} items left"]


def test_a_part_of_a_sentence_is_a_text_too() -> None:
    source = "text = f'Vehicle {v} flies {where or \"elsewhere\"}.'"
    assert texts_of(source) == [
        "Vehicle {0} flies {1}.",
        "elsewhere",
    ]


@pytest.mark.parametrize(
    "source",
    [
        '"""A docstring of some words."""',
        'log.warning("the vehicle %s is gone", v)',
        'if mode == "Hold position": pass',
        'row["Some key"] = 1',
        'field: int = Field(description="A described field.")',
        'db.execute("CREATE TABLE kept (x, y)")',
        'raise AssertionError("cannot be reached at all")',
        'address = f"http://{host}:{port}"',
        'name = "snake_case_name"',
    ],
)
def test_what_nobody_is_shown_is_no_text(source: str) -> None:
    assert texts_of(source) == []


def test_a_catalog_is_read_as_editors_write_it() -> None:
    text = '#: a.py\nmsgid ""\n"Vehicle {0} "\n"is \\"armed\\"."\nmsgstr ""\n"Fahrzeug {0} "\n"ist scharf."\n'
    assert read_catalog(text) == {'Vehicle {0} is "armed".': "Fahrzeug {0} ist scharf."}
    written = quoted("a\n\\b")
    assert read_catalog(f'msgid {written}\nmsgstr "c"\n') == {"a\n\\b": "c"}
