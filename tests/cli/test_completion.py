# SPDX-License-Identifier: Apache-2.0
"""Shell completion offers the verbs, options and values that the program's help lists."""
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
    """Returns an environment with the program on PATH and without user settings."""
    home = tempfile.mkdtemp(prefix="stgs-home-")
    unittest.addModuleCleanup(shutil.rmtree, home, True)
    path = os.path.dirname(harness.STGS) + os.pathsep + os.environ["PATH"]
    return dict(os.environ, HOME=home, PATH=path, TERM="dumb", XDG_CONFIG_HOME=home,
                XDG_DATA_HOME=home, XDG_CACHE_HOME=home, **more)


class Completion:
    """The cases of every shell; complete(line) returns the names that a shell offers."""
    files = {"image.png"}  # offered from the working directory

    def setUp(self):
        super().setUp()
        self.write("image.png", "")

    def test_verbs_are_completed(self):
        self.assertEqual(self.complete("stgs "), set(verbs()))
        self.assertEqual(self.complete("stgs en"), {"encode"})
        self.assertEqual(self.complete("stgs --"), {"--help", "--version"})

    def test_options_of_a_verb_are_completed(self):
        for verb in verbs():
            long = {name for name in options(help_of(verb)) if name.startswith("--")}
            self.assertEqual(self.complete(f"stgs {verb} --"), long)
        self.assertEqual(self.complete("stgs render scene.stgs --ba"), {"--background", "--backend"})

    def test_values_of_an_option_are_completed(self):
        backends = {"auto", "cpu", "cuda", "vulkan"}
        self.assertEqual(self.complete("stgs render --backend "), backends)
        self.assertEqual(self.complete("stgs render --backend c"), {"cpu", "cuda"})
        self.assertEqual(self.complete("stgs render --backend="), backends)
        self.assertEqual(self.complete("stgs render --backend=v"), {"vulkan"})

    def test_other_arguments_are_completed_as_files(self):
        for line in "stgs render ", "stgs render -o p", "stgs render --size ":
            self.assertEqual(self.complete(line), self.files, line)
        self.assertEqual(self.complete("stgs no --"), set())


@unittest.skipUnless(shutil.which("bash"), "needs bash")
class Bash(Completion, CliTest):
    # bash adds files itself where the function offers nothing; see the last test.
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
        run = subprocess.run(["bash", "--norc", "-c", self.PROGRAM, "bash", script("stgs.bash"),
                              harness.STGS, *words[1:]],
                             capture_output=True, text=True, check=True, cwd=self.work)
        self.assertEqual(run.stderr, "")
        return set(run.stdout.split())

    def test_bash_completes_files_itself(self):
        with open(script("stgs.bash"), encoding="utf-8") as file:
            self.assertRegex(file.read(), r"complete .*-o default .*-F _stgs stgs")


@unittest.skipUnless(shutil.which("fish"), "needs fish")
class Fish(Completion, CliTest):
    def complete(self, line):
        run = subprocess.run(["fish", "--no-config", "-c",
                              f"source {script('stgs.fish')}; complete -C $LINE"],
                             capture_output=True, text=True, check=True, cwd=self.work,
                             env=environment(LINE=line))
        self.assertEqual(run.stderr, "")
        offered = [entry.split("\t") for entry in run.stdout.splitlines()]
        self.assertTrue(all(entry[1:] for entry in offered if entry[0].startswith("--h")), offered)
        return {entry[0].split("=")[-1] for entry in offered}


@unittest.skipUnless(shutil.which("zsh"), "needs zsh")
class Zsh(Completion, CliTest):
    # Tab completes and logs the names offered. Calls of compadd that only sort matches offer none.
    SETUP = """
fpath=($FOLDER $fpath)
autoload -Uz compinit
compinit -u -D
unsetopt auto_list auto_menu beep
compadd() {
  local -a hits
  if [[ -z ${@[(r)-[OAD]]} ]]; then
    builtin compadd -A hits "$@"
    print -rl -- "${hits[@]}" >>$OFFERED
  fi
  builtin compadd "$@"
}
ask() { zle complete-word; print -r -- done >>$OFFERED }
zle -N ask
bindkey '^I' ask
PS1='ready> '
"""

    def setUp(self):
        super().setUp()
        self.folder = tempfile.mkdtemp(prefix="stgs-zsh-")
        self.addCleanup(shutil.rmtree, self.folder, True)
        shutil.copy(script("stgs.zsh"), os.path.join(self.folder, "_stgs"))
        with open(os.path.join(self.folder, "setup"), "w", encoding="utf-8") as file:
            file.write(self.SETUP)
        self.terminal, side = pty.openpty()
        self.shell = subprocess.Popen(
            ["zsh", "-f", "-i"], stdin=side, stdout=side, stderr=side, cwd=self.work, close_fds=True,
            start_new_session=True,
            env=environment(FOLDER=self.folder, OFFERED=os.path.join(self.folder, "offered")))
        os.close(side)
        self.addCleanup(self.stop)
        self.output = b""
        self.send(f"source {self.folder}/setup\n")
        self.wait(lambda: b"\nready> " in self.output or b"\rready> " in self.output)

    def stop(self):
        self.shell.kill()
        self.shell.wait()
        os.close(self.terminal)

    def send(self, keys):
        os.write(self.terminal, keys.encode())

    def wait(self, condition):
        deadline = time.monotonic() + 60
        while not condition():
            self.assertLess(time.monotonic(), deadline, self.output)
            if select.select([self.terminal], [], [], 0.02)[0]:
                self.output += os.read(self.terminal, 1 << 16)

    def complete(self, line):
        offered = os.path.join(self.folder, "offered")
        with open(offered, "w", encoding="utf-8"):
            pass

        def lines():
            with open(offered, encoding="utf-8") as file:
                return file.read().split("\n")

        self.send("\x15" + line + "\t")  # Ctrl-U clears the line first
        self.wait(lambda: "done" in lines())
        return set(lines()) - {"", "done"}
