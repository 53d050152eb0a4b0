# SPDX-License-Identifier: Apache-2.0
"""Generates the mutants of spec/reference_decoder for mutate.py: its sources with one change each."""
import ast
import copy
import os

COMPARISONS = {ast.Lt: [ast.LtE, ast.Gt], ast.LtE: [ast.Lt, ast.GtE], ast.Gt: [ast.GtE, ast.Lt], ast.GtE: [ast.Gt, ast.LtE],
               ast.Eq: [ast.NotEq], ast.NotEq: [ast.Eq], ast.In: [ast.NotIn], ast.NotIn: [ast.In], ast.Is: [ast.IsNot],
               ast.IsNot: [ast.Is]}
OPERATORS = {ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.FloorDiv, ast.FloorDiv: ast.Mult, ast.Div: ast.Mult,
             ast.LShift: ast.RShift, ast.RShift: ast.LShift, ast.BitAnd: ast.BitOr, ast.BitOr: ast.BitAnd, ast.Pow: ast.Mult,
             ast.Mod: ast.FloorDiv}
CALLS = {"min": "max", "max": "min", "all": "any", "any": "all"}
UNWRAPPED = {"abs", "clamp", "sorted", "signed", "bool", "reversed", "set"}  # f(x, ...) -> x
# Functions that print, and are no part of a decoder.
SKIPPED = {"main", "print_floats"}


def change(node):
    """Yields a replacement of `node` for each mutation of it."""
    if isinstance(node, ast.Compare):
        for i, op in enumerate(node.ops):
            for other in COMPARISONS[type(op)]:
                new = copy.deepcopy(node)
                new.ops[i] = other()
                yield new
    elif isinstance(node, ast.BoolOp):
        new = copy.deepcopy(node)
        new.op = ast.Or() if isinstance(node.op, ast.And) else ast.And()
        yield new
        for i in range(len(node.values)):  # without one of the conditions
            new = copy.deepcopy(node)
            del new.values[i]
            yield new if len(new.values) > 1 else new.values[0]
    elif isinstance(node, ast.BinOp):
        if type(node.op) in OPERATORS:
            new = copy.deepcopy(node)
            new.op = OPERATORS[type(node.op)]()
            yield new
        if isinstance(node.op, (ast.Mod, ast.LShift, ast.RShift, ast.BitAnd)):
            yield copy.deepcopy(node.left)
    elif isinstance(node, ast.AugAssign) and type(node.op) in OPERATORS:
        new = copy.deepcopy(node)
        new.op = OPERATORS[type(node.op)]()
        yield new
        yield ast.Pass()
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, (ast.Not, ast.USub)):
        yield copy.deepcopy(node.operand)
    elif isinstance(node, ast.Constant) and type(node.value) in (int, float):
        for step in (1, -1):
            yield ast.Constant(node.value + step)
    elif isinstance(node, ast.Subscript) and isinstance(node.slice, ast.Constant) and type(node.slice.value) is int:
        new = copy.deepcopy(node)
        new.slice = ast.Constant(node.slice.value + 1)
        yield new
    elif isinstance(node, ast.Slice):
        for side in ("lower", "upper"):
            if getattr(node, side) is not None and not isinstance(getattr(node, side), ast.Constant):
                new = copy.deepcopy(node)
                setattr(new, side, ast.BinOp(getattr(new, side), ast.Add(), ast.Constant(1)))
                yield new
    elif isinstance(node, ast.Call):
        yield from change_call(node)
    elif isinstance(node, (ast.If, ast.IfExp)):
        new = copy.deepcopy(node)
        new.test = ast.Constant(True)
        yield new
        new = copy.deepcopy(node)
        new.test = ast.Constant(False)
        yield new
    elif isinstance(node, (ast.Raise, ast.Continue, ast.Break)):
        yield ast.Pass()
    elif isinstance(node, ast.Expr) and isinstance(node.value, ast.Call):
        yield ast.Pass()


def change_call(node):
    name = node.func.id if isinstance(node.func, ast.Name) else getattr(node.func, "attr", "")
    if name in CALLS and isinstance(node.func, ast.Name):
        new = copy.deepcopy(node)
        new.func.id = CALLS[name]
        yield new
        if name in ("min", "max") and len(node.args) > 1:
            for argument in node.args:
                yield copy.deepcopy(argument)
    elif name in UNWRAPPED and node.args and isinstance(node.func, ast.Name):
        yield copy.deepcopy(node.args[0])
    elif name == "floor":
        new = copy.deepcopy(node)
        new.func.attr = "ceil"
        yield new


def children(node):
    """Yields (field, index or None, child) of the nodes that may be mutated."""
    skip = ()
    if isinstance(node, ast.Call) and getattr(node.func, "id", "") == "need":
        skip = ("need",)
    for field, value in ast.iter_fields(node):
        items = value if isinstance(value, list) else [value]
        for i, child in enumerate(items):
            if not isinstance(child, ast.AST) or isinstance(child, ast.JoinedStr):
                continue
            if skip and field == "args" and i > 0:  # clause, issue and reason
                continue
            if isinstance(child, ast.FunctionDef) and child.name in SKIPPED:
                continue
            if isinstance(child, ast.AnnAssign) or (isinstance(child, ast.If) and isinstance(node, ast.Module)):
                continue  # fields of classes; "if __name__ ..."
            if isinstance(node, ast.Subscript) and isinstance(child, ast.Constant):
                continue  # an index: mutated with its list
            if isinstance(child, ast.Call) and getattr(child.func, "id", "") == "Refused":
                continue
            if field in ("decorator_list", "annotation", "returns"):
                continue
            yield field, i if isinstance(value, list) else None, child


def sites(node, scope=""):
    """Yields (parent, field, index, child, name of the function) for all nodes below `node`."""
    for field, i, child in children(node):
        inner = child.name if isinstance(child, (ast.FunctionDef, ast.ClassDef)) else scope
        yield node, field, i, child, scope
        yield from sites(child, inner)


def put(parent, field, i, child):
    if i is None:
        setattr(parent, field, child)
    else:
        getattr(parent, field)[i] = child


def mutants(folder):
    """Returns (key, module, source) of all mutants, in a fixed order. The key names the file, the function and
    the change."""
    out, seen = [], {}
    for file in sorted(os.listdir(folder)):
        if not file.endswith(".py") or file == "annotate.py":  # which decodes nothing
            continue
        with open(os.path.join(folder, file), encoding="utf-8") as handle:
            tree = ast.parse(handle.read())
        for parent, field, i, child, scope in list(sites(tree)):
            for new in change(child):
                before = text(child)
                after = text(new)
                if before == after:
                    continue
                put(parent, field, i, new)
                source = ast.unparse(ast.fix_missing_locations(tree))
                put(parent, field, i, child)
                key = f"{file}: {scope}: {before} -> {after}"
                seen[key] = seen.get(key, 0) + 1
                out.append((key if seen[key] == 1 else f"{key} (number {seen[key]})", file[:-3], source))
    return out


def text(node):
    """Returns the source of a node in one line; of a block its first line."""
    return ast.unparse(ast.fix_missing_locations(node)).split("\n")[0]
