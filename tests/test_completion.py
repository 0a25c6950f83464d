"""The scripts for shells complete subcommands, options and files, in a real shell where there is one."""

from __future__ import annotations

import shutil
import subprocess

import pytest

pytest.importorskip("shtab")

from adatracker_deploy.cli import main

PROGRAM = "adatracker-deploy"


@pytest.fixture(scope="module")
def script(tmp_path_factory):
    """Give a function that writes a shell's completion script and returns its path."""
    folder = tmp_path_factory.mktemp("completion")

    def write(shell, capsys):
        assert main(["completion", shell]) == 0
        path = folder / shell
        path.write_text(capsys.readouterr().out)
        return path

    return write


def completed(path, folder, *words):
    """Return the completions that bash offers for the last of the words."""
    line = " ".join(f"'{word}'" for word in (PROGRAM, *words))
    code = (
        f"source '{path}'\n"
        f"COMP_WORDS=({line}); COMP_CWORD={len(words)}\n"
        f"function=$(complete -p {PROGRAM} | sed -E 's/.*-F ([^ ]+).*/\\1/')\n"
        f"\"$function\" {PROGRAM} '{words[-1]}' ''\n"
        'printf "%s\\n" "${COMPREPLY[@]}"'
    )
    done = subprocess.run(
        ["bash", "--norc", "-c", code], check=True, capture_output=True, text=True, cwd=folder
    )
    return done.stdout.split()


@pytest.mark.skipif(shutil.which("bash") is None, reason="no bash here")
@pytest.mark.parametrize(
    ("words", "offered"),
    [
        (("eval",), ["evaluate"]),
        (("sal",), ["salvage"]),
        (("--plat",), ["--platform"]),
        (("push", "--pub"), ["--public"]),
        (("train", "--method", "a"), ["awr"]),
        (("score", "my-tr"), ["my-trial"]),
        (("nothing-like-it",), []),
    ],
)
def test_bash_completes(script, capsys, tmp_path, words, offered):
    (tmp_path / "my-trial").touch()
    assert completed(script("bash", capsys), tmp_path, *words) == offered


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_each_shells_script_is_one_that_it_reads(script, capsys, shell):
    path = script(shell, capsys)
    assert "evaluate" in path.read_text()
    if shutil.which(shell):
        subprocess.run([shell, "-n", path], check=True, capture_output=True)


def test_another_shell_is_refused(capsys):
    assert main(["completion", "ksh"]) == 2
    assert "ksh" in capsys.readouterr().err
