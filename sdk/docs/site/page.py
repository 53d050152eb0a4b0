#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Prints a Markdown page of the repository in the form that Doxygen takes.

usage: page.py FILE

Pages and headings get labels, links between pages become references to these labels, and links to
files that are not part of the site become the paths of those files. Paths of pages and names of the C
interface, as code, become links. The page on JavaScript includes the reference, the file javascript.html.
"""
import functools
import glob
import os
import re
import sys

ROOT = os.path.normpath(os.path.join(os.path.dirname(os.path.abspath(__file__)), "../../.."))
# Folders of the pages, and the first word of their labels.
FOLDERS = {"sdk/docs/site": "start", "sdk/docs/guide": "guide", "sdk/docs": "library",
           "spec": "format", "spec/reference_decoder": "format_decoder", "": "project",
           "tests/bench": "results"}
PROJECT_PAGES = ("ARCHITECTURE.md", "CHANGELOG.md", "CONTRIBUTING.md", "RELEASING.md", "SECURITY.md",
                 "tests/bench/SUMMARY.md")
JAVASCRIPT = "sdk/docs/javascript.md"
FENCE = re.compile(r"^\s*```")
HEADING = re.compile(r"^(#{1,6}) (.*?)\s*$")
# A link, whose text may contain code, or a code span.
LINK_OR_CODE = re.compile(r"(?<!!)\[(?P<text>(?:`[^`]*`|[^\]`])*)\]\((?P<target>[^)\s]+)\)|(?P<code>`[^`]+`)")
IMAGE = re.compile(r"!\[([^\]]*)\]\(([^)\s]+)\)")


def is_page(path):
    """Whether a file, as a path in the repository, is a page of the site."""
    folder = os.path.dirname(path)
    if not path.endswith(".md") or folder not in FOLDERS or not os.path.exists(f"{ROOT}/{path}"):
        return False
    return path in PROJECT_PAGES if folder in ("", "tests/bench") else True


def label_of(path):
    """The label of a page; its HTML file has the same name."""
    if path in ("README.md", "sdk/docs/site/start.md"):
        return "index"
    stem = os.path.basename(path)[:-len(".md")].lower()
    first = FOLDERS[os.path.dirname(path)]
    return first if stem in ("readme", "summary") else f"{first}_{stem}".replace("-", "_")


def slug(title):
    """The anchor that GitHub gives a heading."""
    text = re.sub(r"[`*]|\[([^\]]*)\]\([^)]*\)", r"\1", title).lower()
    return re.sub(r"[^\w -]", "", text).replace(" ", "-")


def reference(label, text):
    """A link with this text, which is in the font of code if it is a code span."""
    plain = text.replace("`", "")
    link = f'@ref {label} "{plain}"'
    return f"<code>{link}</code>" if text == f"`{plain}`" else link


def convert_link(text, target, path):
    if re.match(r"[a-z]+:", target):
        return f"[{text}]({target})"
    file, _, anchor = target.partition("#")
    linked = os.path.normpath(os.path.join(os.path.dirname(path), file)) if file else path
    if not is_page(linked) and linked != "README.md":
        return f"{text} (`{linked}`)" if text.strip("`") != linked else f"`{linked}`"
    label = label_of(linked)
    return reference(f"{label}_{anchor}" if anchor else label, text)


def convert_line(line, path, used):
    heading = HEADING.match(line)
    if heading:
        level, title = heading.groups()
        if len(level) == 1:  # the page itself
            label = label_of(path)
            return line if label == "index" else f"# {title} {{#{label}}}"
        anchor = slug(title)
        used[anchor] = used.get(anchor, -1) + 1
        anchor += f"-{used[anchor]}" if used[anchor] else ""
        return f"{level} {title} {{#{label_of(path)}_{anchor}}}"
    line = IMAGE.sub(lambda match: f"![]({os.path.basename(match.group(2))})", line)
    return LINK_OR_CODE.sub(lambda match: convert_code(match["code"], path) if match["code"] else
                            convert_link(match["text"], match["target"], path), line)


@functools.cache
def headers():
    """The text of the C headers."""
    texts = []
    for path in sorted(glob.glob(f"{ROOT}/sdk/include/stgs/*.h")):
        with open(path, encoding="utf-8") as file:
            texts.append(file.read())
    return "\n".join(texts)


@functools.cache
def declared_functions():
    return set(re.findall(r"^STGS_API[^;]*?\b(stgs_\w+)\(", headers(), re.MULTILINE))


@functools.cache
def declared():
    """The functions, structs and types of the C headers."""
    types = re.findall(r"^(?:typedef [\w ]+|\}) (stgs_\w+);", headers(), re.MULTILINE)
    return declared_functions() | set(types)


def convert_code(code, path):
    """A code span; a link if it names a page, by its path from this page's folder or from the root,
    or something declared."""
    name = code.strip("`")
    if name in declared():
        return reference(name, code)
    for linked in (os.path.join(os.path.dirname(path), name), name):
        linked = os.path.normpath(linked)
        if is_page(linked) and linked != path:
            return reference(label_of(linked), code)
    return code


def convert(text, path):
    text = re.sub(r"^<!--.*?-->\n", "", text, flags=re.DOTALL | re.MULTILINE)
    lines, fenced, used = [], False, {}
    for line in text.splitlines():
        fenced ^= bool(FENCE.match(line))
        as_is = fenced or FENCE.match(line) or line.startswith("    ")
        lines.append(line if as_is else convert_line(line, path, used))
    return "\n".join(lines) + "\n"


def main():
    path = os.path.relpath(os.path.abspath(sys.argv[1]), ROOT).replace(os.sep, "/")
    with open(sys.argv[1], encoding="utf-8") as file:
        sys.stdout.write(convert(file.read(), path))
    if path == JAVASCRIPT:
        sys.stdout.write("\n@htmlinclude javascript.html\n")


if __name__ == "__main__":
    main()
