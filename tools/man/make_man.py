#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Generates the manual pages from the help of the program: stgs.1.gz, and stgs-VERB.1.gz for each
verb.

usage: make_man.py STGS FOLDER
"""
import gzip
import os
import re
import subprocess
import sys

HEADING = re.compile(r"([A-Z][A-Za-z ]*):$")
ITEM = re.compile(r"  (?! )(.+?)(?:\s{2,}(\S.*))?$")
# An argument as printed in the help: --format TEXT:{text,json}=text Needs: --other
VALUE = re.compile(r"(?P<type>[A-Z]+)(?![a-z])(?:\:\{(?P<choices>[^}]*)\})?(?P<range>:\S+ in \[[^]]*\])?"
                   r"(?:=(?P<default>\S+))?(?P<rest>.*)")


def help_of(program, *verb):
    return subprocess.run([program, *verb, "--help"], capture_output=True, text=True,
                          check=True).stdout.splitlines()


def roff(text):
    """Escapes text for roff. Hyphens become ASCII hyphens, which can be searched and copied."""
    text = text.replace("\\", "\\e").replace("-", "\\-")
    return "\\&" + text if text[:1] in (".", "'") else text


def described(lines):
    """Returns [head, description] for each option, argument or verb."""
    pairs = []
    for line in lines:
        item = ITEM.match(line)
        if item:
            pairs.append([item.group(1), item.group(2) or ""])
        else:
            pairs[-1][1] = f"{pairs[-1][1]} {line.strip()}".strip()
    return pairs


def head(text):
    name, _, rest = text.partition(" ")
    shown = f"\\fB{roff(name.replace(',', ', '))}\\fR"
    value = VALUE.fullmatch(rest) if name.startswith("-") else None
    if value is None:
        return f"{shown} {roff(re.sub('^TEXT ?', '', rest).replace('REQUIRED', '(required)'))}".strip()
    kind = value["choices"].replace(",", "|") if value["choices"] else value["type"].lower()
    shown += f" \\fI{roff(kind)}\\fR{roff((value['range'] or '').replace(':', ' '))}"
    if value["default"]:
        shown += f" (default: {roff(value['default'])})"
    return shown + roff(value["rest"].replace("REQUIRED", "(required)"))


def sections(lines):
    """Splits a help into (heading, lines). Text between groups has the heading ''."""
    found = [("", [])]
    for line in lines:
        heading = HEADING.match(line)
        if heading:
            found.append((heading.group(1), []))
        elif line.startswith("Usage: "):
            found += [("Usage", [line[len("Usage: "):]]), ("", [])]
        elif line.startswith("Exit codes: "):
            found.append(("Exit codes", [line[len("Exit codes: "):]]))
        elif not line and found[-1][0] != "Example":
            found.append(("", []))
        elif line:
            found[-1][1].append(line)
    return [(name, body) for name, body in found if body]


def page(name, lines, others, version):
    parts = sections(lines)
    text = [" ".join(body) for heading, body in parts if not heading]
    summary = text[0].rstrip(".")
    out = [f'.TH {name.upper()} 1 "" "stgs {version}" "User Commands"', ".SH NAME",
           f"{roff(name)} \\- {roff(summary.removeprefix('STGS '))}", ".SH SYNOPSIS"]
    usage = dict(parts)["Usage"][0]
    program, _, arguments = usage.partition(" [")
    out += [f"\\fB{roff(program)}\\fR [{roff(arguments)}", ".SH DESCRIPTION", roff(summary + ".")]
    for paragraph in text[1:]:
        out += [".PP", roff(paragraph)]
    for heading, body in parts:
        if heading == "Example":
            out += [".SH EXAMPLES", ".EX", *(roff(line.strip()) for line in body), ".EE"]
        elif heading == "Exit codes":
            out.append(".SH EXIT STATUS")
            for code in " ".join(line.strip() for line in body).rstrip(".").split(", "):
                number, _, meaning = code.partition(" ")
                out += [".TP", f".B {number}", roff(meaning)]
        elif heading == "Subcommands":
            out.append(".SH VERBS")
            for verb, summary_of_verb in described(body):
                out += [".TP", f".BR {roff(name + '-' + verb)} (1)", roff(summary_of_verb)]
        elif heading not in ("", "Usage"):
            out.append(f".SH {heading.upper()}")
            for item, description in described(body):
                out += [".TP", head(item), roff(description)]
    out += [".SH SEE ALSO", ",\n".join(f".BR {roff(other)} (1)" for other in others)]
    return "\n".join(out) + "\n"


def main():
    program, folder = sys.argv[1:]
    top = help_of(program)
    version = subprocess.run([program, "--version"], capture_output=True, text=True,
                             check=True).stdout.split()[1]
    verbs = [verb for verb, _ in described(dict(sections(top))["Subcommands"])]
    names = ["stgs"] + [f"stgs-{verb}" for verb in verbs]
    os.makedirs(folder, exist_ok=True)
    for name, verb in zip(names, [[], *([verb] for verb in verbs)]):
        text = page(name, help_of(program, *verb), [other for other in names if other != name],
                    version)
        # mtime=0: reproducible output.
        with open(os.path.join(folder, f"{name}.1.gz"), "wb") as file:
            file.write(gzip.compress(text.encode(), 9, mtime=0))


if __name__ == "__main__":
    main()
