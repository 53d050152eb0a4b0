# SPDX-License-Identifier: Apache-2.0
"""Rewrites the headers of format/include/stgs/format/math as WGSL.

Only the declarations and the forms of statements that these headers have are supported; names and
expressions stay as they are. Anything else is rejected, here or by the compiler of WGSL.
"""
import re

TYPES = {"float": "f32", "int": "i32", "bool": "bool"}
# Names of GLSL that WGSL writes differently.
CALLS = {"floatBitsToUint": "bitcast<u32>"}
FUNCTION = re.compile(r"(\w+) (\w+)\(([\w\s,]*)\)")


def type_of(name):
    return TYPES.get(name, name)


def statements_of(lines):
    """Yields the pieces of the text that end with a semicolon or a brace."""
    for piece in re.findall(r"[^;{}]*[;{}]", " ".join(lines)):
        yield " ".join(piece.split())


def members_of(piece):
    """Returns the members of `float x, y` or `float v[16]`."""
    kind, names = piece.split(" ", 1)
    members = []
    for name in names.split(","):
        name, size = re.fullmatch(r"\s*(\w+)(?:\[(\d+)\])?\s*", name).groups()
        written = type_of(kind)
        members.append(f"{name}: array<{written}, {size}>," if size else f"{name}: {written},")
    return " ".join(members)


def expression_of(text):
    """Rewrites a conditional expression, which may not be nested, and the calls."""
    for name, written in CALLS.items():
        text = re.sub(rf"\b{name}\(", f"{written}(", text)
    if "?" not in text:
        return text
    match = re.fullmatch(r"([^?:]+) \? ([^?:]+) : ([^?:]+)", text)
    if not match:
        raise ValueError(f"{text}: only one conditional expression per statement is supported")
    condition, yes, no = match.groups()
    return f"select({no}, {yes}, {condition})"


def statement_of(piece):
    """Rewrites a statement of a function, without its semicolon."""
    match = re.fullmatch(r"if \((.+)\) (return\b.*)", piece)
    if match:
        return f"if ({match[1]}) {{ {statement_of(match[2])} }}"
    match = re.fullmatch(r"return (.+)", piece)
    if match:
        return f"return {expression_of(match[1])};"
    match = re.fullmatch(r"(\w+) (\w+)", piece)
    if match:
        return f"var {match[2]}: {type_of(match[1])};"
    match = re.fullmatch(r"(?:(\w+) )?([\w.\[\]]+) = (.+)", piece)
    if not match:
        raise ValueError(f"{piece}: no such statement is supported")
    kind, name, value = match.groups()
    start = f"let {name}: {type_of(kind)}" if kind else name
    return f"{start} = {expression_of(value)};"


def global_of(piece):
    """Rewrites a constant, or the beginning of a structure or a function."""
    match = re.fullmatch(r"const (\w+) (\w+) = ([^?]+);", piece)
    if match:
        return f"const {match[2]}: {type_of(match[1])} = {match[3]};"
    if re.fullmatch(r"struct \w+ \{", piece):
        return piece
    match = FUNCTION.fullmatch(piece[:-2])
    if not match or not piece.endswith(" {"):
        raise ValueError(f"{piece}: no such declaration is supported")
    parameters = [one.split() for one in match[3].split(",")] if match[3] else []
    written = ", ".join(f"{name}: {type_of(kind)}" for kind, name in parameters)
    return f"fn {match[2]}({written}) -> {type_of(match[1])} {{"


def rewrite(lines):
    """Returns the lines of a header, whose directives are resolved, as WGSL. Raises ValueError."""
    out = []
    inside = ""  # "struct", "function", or nothing
    for piece in statements_of(lines):
        if piece in ("}", "};", ";"):
            out += ["}"] if inside else []
            inside = ""
        elif inside == "struct":
            out.append("  " + members_of(piece[:-1]))
        elif inside:
            out.append("  " + statement_of(piece[:-1]))
        else:
            out.append(global_of(piece))
            if piece.endswith("{"):
                inside = "struct" if piece.startswith("struct") else "function"
    return out


def declarations_of(lines):
    """Returns the declarations of rewritten lines: pairs of a name and its text."""
    found = []
    for line in lines:
        match = re.match(r"(?:fn|struct|const) (\w+)", line)
        if match:
            found.append([match[1], line])
        else:
            found[-1][1] += "\n" + line
    return found


def used(declarations, text):
    """Returns the texts of the declarations that `text` uses, also through others."""
    texts = dict(declarations)
    names, needed = set(), set(re.findall(r"\w+", text)) & set(texts)
    while needed:
        names |= needed
        inside = {word for name in needed for word in re.findall(r"\w+", texts[name])}
        needed = inside & set(texts) - names
    return [body for name, body in declarations if name in names]
