"""`tools.checks` shows the output of a failed check and then fails itself."""

import sys

from tools.checks import Check, main, run_all


def check(name, program):
    return Check(name, (sys.executable, "-c", program))


PASSING_CHECK = check("good", "print('nothing to say')")
FAILING_CHECK = check("bad", "print('line 3: unused'); raise SystemExit(1)")


def test_a_failed_check_fails_the_run_and_its_output_is_shown(capsys):
    assert not run_all([FAILING_CHECK, PASSING_CHECK])
    output = capsys.readouterr().out
    assert "line 3: unused" in output
    assert "bad: FAILED" in output
    assert "good: ok" in output


def test_passed_checks_show_only_their_duration(capsys):
    assert run_all([PASSING_CHECK])
    assert "nothing to say" not in capsys.readouterr().out


def test_an_unknown_group_is_refused_with_the_list_of_groups(capsys):
    assert main(["lints"]) == 2
    assert "Choose from lint, page, style." in capsys.readouterr().err
