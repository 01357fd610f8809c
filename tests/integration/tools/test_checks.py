"""The checks beside the tests: what fails is shown and makes the whole fail."""

import sys

from tools.checks import Check, main, run_all


def check(name, program):
    return Check(name, (sys.executable, "-c", program))


GOOD = check("good", "print('nothing to say')")
BAD = check("bad", "print('line 3: unused'); raise SystemExit(1)")


def test_a_check_that_fails_fails_the_whole_and_shows_what_it_said(capsys):
    assert not run_all([BAD, GOOD])
    said = capsys.readouterr().out
    assert "line 3: unused" in said
    assert "bad: FAILED" in said
    assert "good: ok" in said


def test_checks_that_pass_say_only_how_long_they_took(capsys):
    assert run_all([GOOD])
    assert "nothing to say" not in capsys.readouterr().out


def test_an_unknown_group_is_refused_with_those_that_there_are(capsys):
    assert main(["lints"]) == 2
    assert "Choose from lint, page." in capsys.readouterr().err
