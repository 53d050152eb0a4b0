#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Checks the source tree: includes between modules, verbs that use the public SDK alone, one
definition per type name, file lengths, licence lines, and temporary files of tests in one folder.

usage: check_sources.py ROOT     exit code 0: clean; 1: problems, one per line on stdout
"""
import os
import re
import sys

# The modules whose headers each module may include.
MAY_INCLUDE = {
    "format": {"format"},
    "player": {"format", "player"},
    "sdk": {"format", "player", "sdk"},
    "sdk/encoder": {"format", "encoder", "sdk"},  # libstgs_encoder, which players do not link
    "encoder": {"format", "encoder"},
    "tools": {"format", "player", "sdk", "encoder", "tools"},
    "tests": {"format", "player", "sdk", "encoder", "tools", "tests"},
}
PARTS = {"sdk/src/encoder/": "sdk/encoder"}  # folders of a module with a rule of their own
CAPTURE_SIDE = ("encoder/src/capture/", "encoder/src/init/", "tools/", "tests/")
# Libraries that only some folders may use: header pattern, name, allowed folders.
CONFINED = [
    (re.compile(r"opencv2/"), "OpenCV", CAPTURE_SIDE),
    (re.compile(r"(OpenEXR/)?(Imf|Imath|Iex)\w*\.h$"), "OpenEXR", CAPTURE_SIDE),
    (re.compile(r"colmap/"), "COLMAP", CAPTURE_SIDE),
    (re.compile(r"(toml\+\+/|pugixml)"), "toml++ and pugixml", CAPTURE_SIDE),
    (re.compile(r"lib(av\w+|swscale|swresample)/"), "FFmpeg", CAPTURE_SIDE),
]
# Sources of verbs that use the library as applications do, and the internal headers that they may
# reach through headers of the tools: errors, the processes and progress of the session, times, images,
# and prepared captures with their cameras, which are no scenes.
PUBLIC_VERBS = re.compile(r"tools/(stgs/(cmd_(info|play|render)|play/\w+|player_events|"
                          r"scene_(file|info\w*|renderer))|vulkan_host/\w+)\.(cpp|h)$")
PUBLIC_HELPERS = {
    "stgs/format/status.h", "stgs/encoder/progress.h", "stgs/encoder/ranks.h",
    "stgs/format/gaussian4d.h", "stgs/format/raster.h",  # TimeBase, Image
    "stgs/encoder/prepared_capture.h",
}
TOP_LEVEL = {
    "encoder", "format", "player", "sdk", "spec", "tests", "tools", "cmake", ".ci", ".github",
    "CMakeLists.txt", "CMakePresets.json", "Makefile", "Dockerfile", "README.md", "LICENSE",
    "CHANGELOG.md", "ARCHITECTURE.md", "CONTRIBUTING.md", "SECURITY.md", "RELEASING.md",
    ".clang-format", ".clang-tidy", ".dockerignore", ".editorconfig", ".gitignore",
    ".pre-commit-config.yaml",
}
NOT_SOURCE = {".git", "build"}  # besides the top-level entries that .gitignore lists
CODE = (".h", ".hpp", ".c", ".cpp", ".cu", ".cuh", ".comp", ".glsl")
SCRIPTS = (".py", ".sh", ".cmake", ".ts", ".js", ".mjs", ".wgsl")
MAX_LINES = 400
TEMPORARY = "tests/fixtures/temporary_folder.h"  # the only test source that may use temp_directory_path

INCLUDE = re.compile(r'^\s*#\s*include\s*(["<])([^">]+)[">]')
NAMESPACE = re.compile(r"(?:inline )?namespace ?([\w:]*) ?\{$")
TYPE = re.compile(r"(?:class|struct|union|enum class|enum)(?: alignas\(\w+\))? (\w+)(?!\w|::)[^;(<]*\{")
LICENCE = "SPDX-License-Identifier: Apache-2.0"


def ignored_top_level(root):
    names = set(NOT_SOURCE)
    path = os.path.join(root, ".gitignore")
    if os.path.exists(path):
        with open(path, encoding="utf-8") as lines:
            names |= {line.strip().strip("/") for line in lines if line.startswith("/")}
    return names


def source_files(root, endings):
    """Returns the paths below root, with forward slashes, of files with these endings. ".cmake"
    includes CMakeLists.txt and Makefile."""
    found = []
    ignored = ignored_top_level(root)
    for folder, folders, names in os.walk(root):
        if folder == root:
            folders[:] = [name for name in folders if name not in ignored]
        folders[:] = sorted(name for name in folders if name not in (".git", "__pycache__"))
        for name in sorted(names):
            build_script = name in ("CMakeLists.txt", "Makefile") and ".cmake" in endings
            if name.endswith(endings) or build_script:
                found.append(os.path.relpath(os.path.join(folder, name), root).replace(os.sep, "/"))
    return found


def included_module(root, path, quote, header):
    """Returns the module of an included header, or None if the header is not part of STGS."""
    if header.startswith("stgs/"):
        name = header.split("/")[1]
        return name if name in MAY_INCLUDE else "sdk"  # such as stgs/stgs.h
    if quote == '"':
        sibling = os.path.normpath(os.path.join(root, os.path.dirname(path), header))
        if os.path.exists(sibling):
            return os.path.relpath(sibling, root).split(os.sep)[0]
    return None


def check_includes(root, path, lines):
    module = next((part for folder, part in PARTS.items() if path.startswith(folder)),
                  path.split("/")[0])
    allowed = MAY_INCLUDE.get(module)
    if allowed is None:
        return
    for number, line in enumerate(lines, 1):
        match = INCLUDE.match(line)
        if not match:
            continue
        quote, header = match.groups()
        target = included_module(root, path, quote, header)
        if target is not None and target not in allowed:
            yield f"{path}:{number}: {module} must not include {target} ({header})"
        for pattern, library, folders in CONFINED:
            if pattern.match(header) and not path.startswith(folders):
                yield f"{path}:{number}: {library} is only for {', '.join(folders)} ({header})"


def internal_headers(root, path, seen):
    """Yields (line, header) of the includes of a public verb that are not headers of the SDK,
    directly or through headers of the tools."""
    with open(os.path.join(root, path), encoding="utf-8") as file:
        lines = file.read().splitlines()
    for number, line in enumerate(lines, 1):
        match = INCLUDE.match(line)
        if not match:
            continue
        header = match.group(2)
        if header.startswith("stgs/"):
            if included_module(root, path, *match.groups()) != "sdk" and header not in PUBLIC_HELPERS:
                yield number, header
            continue
        for folder in (os.path.dirname(path), "tools/stgs", "tools"):
            beside = os.path.normpath(os.path.join(folder, header))
            if match.group(1) == '"' and os.path.exists(os.path.join(root, beside)):
                if beside not in seen:
                    seen.add(beside)
                    for _, inner in internal_headers(root, beside, seen):
                        yield number, f"{inner} through {header}"
                break


def check_public_verb(root, path):
    if not PUBLIC_VERBS.match(path):
        return
    for number, header in internal_headers(root, path, {path}):
        yield f"{path}:{number}: this verb may use only the public headers of the SDK ({header})"


def check_include_root(path):
    """Checks that public headers are in MODULE/include/stgs/MODULE, those of the SDK in
    sdk/include/stgs."""
    parts = path.split("/")
    if "include" not in parts[:-1]:
        return
    module = parts[0]
    home = "sdk/include/stgs/" if module == "sdk" else f"{module}/include/stgs/{module}/"
    if module in MAY_INCLUDE and module not in ("tests", "tools") and not path.startswith(home):
        yield f"{path}: a public header of {module} belongs in {home}"


def check_temporary(path, lines):
    """Checks that only TEMPORARY uses the system's temporary folder: the cases of a program run in
    parallel and would share a file with a fixed name."""
    if not path.startswith("tests/") or path == TEMPORARY:
        return
    for number, line in enumerate(lines, 1):
        if "temp_directory_path" in line:
            yield f"{path}:{number}: temporary files of tests belong in the folder of {TEMPORARY}"


def named_types(lines):
    """Yields (line number, full name) of each type that a file defines outside unnamed namespaces."""
    spaces = []
    for number, line in enumerate(lines, 1):
        opened, found = NAMESPACE.match(line), TYPE.match(line)
        if opened:
            spaces.append(opened.group(1))
        elif line.startswith("}  // namespace") and spaces:
            spaces.pop()
        elif found and spaces and all(spaces):
            yield number, "::".join(spaces + [found.group(1)])


def check(root):
    problems = []
    types = {}  # full name -> path of its definition
    for name in sorted(os.listdir(root)):
        if name not in TOP_LEVEL and name not in ignored_top_level(root):
            problems.append(f"{name}: not one of the folders and files allowed at the top level")
    for path in source_files(root, CODE + SCRIPTS):
        with open(os.path.join(root, path), encoding="utf-8") as file:
            lines = file.read().splitlines()
        # The first line of a script may name its interpreter.
        if not any(LICENCE in line for line in lines[:2]):
            problems.append(f"{path}:1: no line '{LICENCE}'")
        if len(lines) > MAX_LINES:
            problems.append(f"{path}: {len(lines)} lines, more than {MAX_LINES}: split it")
        if path.endswith(CODE):
            problems += check_includes(root, path, lines)
            problems += check_public_verb(root, path)
            problems += check_include_root(path)
            problems += check_temporary(path, lines)
        if path.endswith(CODE) and not path.startswith("tests/"):  # each test is a program of its own
            for number, name in named_types(lines):
                if types.setdefault(name, path) != path:
                    problems.append(f"{path}:{number}: {name} is defined in {types[name]} too")
    return problems


def main():
    if len(sys.argv) != 2 or not os.path.isdir(sys.argv[1]):
        sys.exit(__doc__)
    problems = check(sys.argv[1])
    for problem in problems:
        print(problem)
    print(f"{len(source_files(sys.argv[1], CODE + SCRIPTS))} files, {len(problems)} problems")
    sys.exit(1 if problems else 0)


if __name__ == "__main__":
    main()
