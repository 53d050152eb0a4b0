# SPDX-License-Identifier: Apache-2.0
"""What the shells offer behind `stgs` is what the program's help says."""
import os
import pty
import select
import shutil
import subprocess
import tempfile
import time
import unittest

import harness
from harness import CliTest
from test_manual import help_of, options, verbs

FOLDER = "tools/completion"


def script(name):
    return os.path.join(harness.SOURCE, FOLDER, name)


def environment(**more):
    """With the program as `stgs`, and nobody's settings."""
    home = tempfile.mkdtemp(prefix="stgs-home-")
    unittest.addModuleCleanup(shutil.rmtree, home, True)
    path = os.path.dirname(harness.STGS) + os.pathsep + os.environ["PATH"]
    return dict(os.environ, HOME=home, PATH=path, TERM="dumb", XDG_CONFIG_HOME=home,
                XDG_DATA_HOME=home, XDG_CACHE_HOME=home, **more)


class Offers:
    """What each shell must offer; complete(line) gives the names that it does."""
    files = {"picture.png"}  # of the working directory, where files are offered

    def setUp(self):
        super().setUp()
        self.write("picture.png", "")

    def test_verbs(self):
        self.assertEqual(self.complete("stgs "), set(verbs()))
        self.assertEqual(self.complete("stgs en"), {"encode"})
        self.assertEqual(self.complete("stgs --"), {"--help", "--version"})

    def test_options_of_a_verb(self):
        for verb in verbs():
            long = {name for name in options(help_of(verb)) if name.startswith("--")}
            self.assertEqual(self.complete(f"stgs {verb} --"), long)
        self.assertEqual(self.complete("stgs render scene.stgs --ba"), {"--background", "--backend"})

    def test_values_of_an_option(self):
        backends = {"auto", "cpu", "cuda", "vulkan"}
        self.assertEqual(self.complete("stgs render --backend "), backends)
        self.assertEqual(self.complete("stgs render --backend c"), {"cpu", "cuda"})
        self.assertEqual(self.complete("stgs render --backend="), backends)
        self.assertEqual(self.complete("stgs render --backend=v"), {"vulkan"})

    def test_all_else_is_left_to_files(self):
        for line in "stgs render ", "stgs render -o p", "stgs render --size ":
            self.assertEqual(self.complete(line), self.files, line)
        self.assertEqual(self.complete("stgs no --"), set())


@unittest.skipUnless(shutil.which("bash"), "needs bash")
class Bash(Offers, CliTest):
    # bash adds them where the function offers nothing, as the last test says.
    files = set()
    PROGRAM = """
source "$1"
shift
COMP_WORDS=("$@") COMP_CWORD=$(($# - 1))
_stgs
printf '%s\\n' "${COMPREPLY[@]}"
"""

    def complete(self, line):
        words = line.replace("=", " = ").split(" ")
        if line.endswith("="):
            words.pop()
        shown = subprocess.run(["bash", "--norc", "-c", self.PROGRAM, "bash", script("stgs.bash"),
                                harness.STGS, *words[1:]],
                               capture_output=True, text=True, check=True, cwd=self.work)
        self.assertEqual(shown.stderr, "")
        return set(shown.stdout.split())

    def test_files_are_bashs_own(self):
        with open(script("stgs.bash"), encoding="utf-8") as file:
            self.assertRegex(file.read(), r"complete .*-o default .*-F _stgs stgs")


@unittest.skipUnless(shutil.which("fish"), "needs fish")
class Fish(Offers, CliTest):
    def complete(self, line):
        shown = subprocess.run(["fish", "--no-config", "-c",
                                f"source {script('stgs.fish')}; complete -C $LINE"],
                               capture_output=True, text=True, check=True, cwd=self.work,
                               env=environment(LINE=line))
        self.assertEqual(shown.stderr, "")
        offered = [entry.split("\t") for entry in shown.stdout.splitlines()]
        self.assertTrue(all(said[1:] for said in offered if said[0].startswith("--h")), offered)
        return {said[0].split("=")[-1] for said in offered}


@unittest.skipUnless(shutil.which("zsh"), "needs zsh")
class Zsh(Offers, CliTest):
    # Tab completes, and tells what was offered. What only sorts matches offers none.
    SETUP = """
fpath=($FOLDER $fpath)
autoload -Uz compinit
compinit -u -D
unsetopt auto_list auto_menu beep
compadd() {
  local -a hits
  if [[ -z ${@[(r)-[OAD]]} ]]; then
    builtin compadd -A hits "$@"
    print -rl -- "${hits[@]}" >>$TOLD
  fi
  builtin compadd "$@"
}
ask() { zle complete-word; print -r -- done >>$TOLD }
zle -N ask
bindkey '^I' ask
PS1='ready> '
"""

    def setUp(self):
        super().setUp()
        self.told = tempfile.mkdtemp(prefix="stgs-zsh-")
        self.addCleanup(shutil.rmtree, self.told, True)
        shutil.copy(script("stgs.zsh"), os.path.join(self.told, "_stgs"))
        with open(os.path.join(self.told, "setup"), "w", encoding="utf-8") as file:
            file.write(self.SETUP)
        self.terminal, side = pty.openpty()
        self.shell = subprocess.Popen(
            ["zsh", "-f", "-i"], stdin=side, stdout=side, stderr=side, cwd=self.work, close_fds=True,
            start_new_session=True,
            env=environment(FOLDER=self.told, TOLD=os.path.join(self.told, "told")))
        os.close(side)
        self.addCleanup(self.end)
        self.said = b""
        self.send(f"source {self.told}/setup\n")
        self.wait(lambda: b"\nready> " in self.said or b"\rready> " in self.said)

    def end(self):
        self.shell.kill()
        self.shell.wait()
        os.close(self.terminal)

    def send(self, keys):
        os.write(self.terminal, keys.encode())

    def wait(self, holds):
        end = time.monotonic() + 60
        while not holds():
            self.assertLess(time.monotonic(), end, self.said)
            if select.select([self.terminal], [], [], 0.02)[0]:
                self.said += os.read(self.terminal, 1 << 16)

    def complete(self, line):
        told = os.path.join(self.told, "told")
        with open(told, "w", encoding="utf-8"):
            pass

        def lines():
            with open(told, encoding="utf-8") as file:
                return file.read().split("\n")

        self.send("\x15" + line + "\t")  # over what the line was
        self.wait(lambda: "done" in lines())
        return set(lines()) - {"", "done"}
