#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Prints a public header in the form that Doxygen takes.

usage: header.py FILE

Plain comments of the C headers become Doxygen's: that of the file at the top, those before a
declaration or a member, those behind one. Functions named in comments become links.
"""
import re
import sys

from page import declared_functions

DECLARATION_ENDS = r"^( *[^ /*].*[;,)}]) */\* "
ENUMERATOR = r"^( *[A-Z_0-9]+ = [-A-Z_0-9() ]+) */\* "
CONSTANT = r"^(#define [A-Z_0-9]+ [A-Z_0-9]+) */\* "


def convert_c_comments(text):
    text = re.sub(r"\A(/\* SPDX.*\n)/\* ", r"\1/** @file\n * ", text)
    text = re.sub(r"^( *)/\* (?!SPDX)", r"\1/** ", text, flags=re.MULTILINE)
    for behind in (DECLARATION_ENDS, ENUMERATOR, CONSTANT):
        text = re.sub(behind, r"\1 /**< ", text, flags=re.MULTILINE)
    # Every struct begins with its size, which the rules at the top of stgs.h explain.
    text = re.sub(r"^( *size_t struct_size;)$", r"\1 /**< sizeof the struct, set by the caller. */", text,
                  flags=re.MULTILINE)
    # The enumerators of an integer type are in an enum without a name.
    return re.sub(r"^(typedef int32_t (\w+);\n)enum \{$", r"\1/** Values of \2. */\nenum {", text,
                  flags=re.MULTILINE)


def link_functions(comment):
    """Functions are linked where their name is followed by parentheses."""
    return re.sub(r"(?<![\w`])(stgs_\w+)(?!\w|\(|`|\.\w)",
                  lambda match: match[1] + "()" if match[1] in declared_functions() else match[1], comment)


def main():
    with open(sys.argv[1], encoding="utf-8") as file:
        text = convert_c_comments(file.read())
    sys.stdout.write(re.sub(r"/\*.*?\*/|///[^\n]*", lambda match: link_functions(match[0]), text,
                            flags=re.DOTALL))


if __name__ == "__main__":
    main()
