#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""The type stubs of the Python module match the module: classes, members, parameters, defaults.

usage: test_python_stubs.py STUBS, with the module on PYTHONPATH
"""
import ast
import re
import sys
import unittest

import stgs

STUBS = sys.argv[1]
SPECIAL = {"__len__", "__enter__", "__exit__", "__copy__"}  # not defined by every class


def is_public(name):
    return not name.startswith("_") or name in SPECIAL


def read_stubs():
    with open(STUBS, encoding="utf-8") as file:
        tree = ast.parse(file.read())
    return {node.name: node for node in tree.body
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_")}


def functions_of(node):
    return [item for item in node.body if isinstance(item, ast.FunctionDef)]


def is_property(function):
    return any(isinstance(d, ast.Name) and d.id == "property" for d in function.decorator_list)


def attributes_of(node):
    """Returns the names of settable members: annotated attributes."""
    return {item.target.id for item in node.body if isinstance(item, ast.AnnAssign)}


def properties_of(node):
    return {f.name for f in functions_of(node) if is_property(f)}


def parameters_of_stub(function):
    """Returns pairs of a name and the text of its default, or None."""
    args = function.args
    names = args.posonlyargs + args.args
    defaults = [None] * (len(names) - len(args.defaults)) + args.defaults
    pairs = list(zip(names, defaults)) + list(zip(args.kwonlyargs, args.kw_defaults))
    return [(name.arg, default and ast.unparse(default)) for name, default in pairs
            if name.arg != "self"]


def parameters_of_module(method):
    """Returns the same pairs from pybind11's signature, the first line of the docstring."""
    first = method.__doc__.splitlines()[0]
    inside = re.match(r"\w+\((.*)\) -> ", first).group(1)
    parts, depth, part = [], 0, ""
    for character in inside:
        depth += {"[": 1, "(": 1, "]": -1, ")": -1}.get(character, 0)
        if character == "," and depth == 0:
            parts.append(part)
            part = ""
        else:
            part += character
    parts.append(part)
    out = []
    for text in parts:
        name, _, rest = text.strip().partition(":")
        if name in ("self", "*") or name.startswith("*"):
            continue
        default = rest.split(" = ")[1] if " = " in rest else None
        out.append((name, default))
    return out


class Stubs(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.stubs = read_stubs()
        cls.classes = {name: value for name, value in vars(stgs).items()
                       if isinstance(value, type) and not name.startswith("_")}

    def test_classes_match_the_module(self):
        self.assertEqual(set(self.stubs), set(self.classes))
        self.assertGreater(len(self.stubs), 10)

    def test_members_match_the_module(self):
        for name, stub in self.stubs.items():
            if name == "Error":
                continue  # attributes belong to instances; see test_errors_have_their_attributes()
            with self.subTest(name):
                found = {member for member in vars(self.classes[name]) if is_public(member)}
                declared = {f.name for f in functions_of(stub)} - {"__init__"}
                self.assertEqual(declared | attributes_of(stub), found)

    def test_settable_properties_match_the_module(self):
        for name, stub in self.stubs.items():
            for member, value in vars(self.classes[name]).items():
                if not isinstance(value, property):
                    continue
                with self.subTest(f"{name}.{member}"):
                    self.assertEqual(member in attributes_of(stub), value.fset is not None)
                    self.assertEqual(member in properties_of(stub), value.fset is None)

    def test_parameters_match_the_module(self):
        compared = 0
        for name, stub in self.stubs.items():
            for function in functions_of(stub):
                method = vars(self.classes[name]).get(function.name)
                if is_property(function) or function.name in SPECIAL or method is None:
                    continue
                with self.subTest(f"{name}.{function.name}"):
                    self.check_parameters(name, function, method)
                    compared += 1
        self.assertGreater(compared, 20)

    def check_parameters(self, name, function, method):
        declared, found = parameters_of_stub(function), parameters_of_module(method)
        if name == "Player" and function.name == "__init__":
            # Settings are passed as **kwargs; each must be known.
            self.assertEqual(found, declared[:1])
            for setting, _ in declared[1:]:
                with self.assertRaises(TypeError) as caught:
                    stgs.Player(b"", **{setting: "none"})
                self.assertEqual(str(caught.exception),
                                 f"Player: {setting} must be a number in range, not 'none'")
            return
        self.assertEqual(declared, found)

    def test_signatures_contain_no_cpp_types(self):
        for name, value in self.classes.items():
            for member, method in vars(value).items():
                if callable(method) and method.__doc__:
                    self.assertNotIn("::", method.__doc__, f"{name}.{member}")

    def test_errors_have_their_attributes(self):
        with self.assertRaises(stgs.Error) as caught:
            stgs.Scene("no such file")
        for attribute in attributes_of(self.stubs["Error"]):
            self.assertTrue(hasattr(caught.exception, attribute), attribute)
        self.assertTrue(issubclass(stgs.Error, RuntimeError))


if __name__ == "__main__":
    unittest.main(argv=["test_python_stubs.py", *sys.argv[2:]])
