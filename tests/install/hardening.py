# SPDX-License-Identifier: Apache-2.0
"""What the hardening flags (cmake/hardening.cmake) leave in an ELF file, read with readelf."""
import re
import subprocess

ENDBR64 = b"\xf3\x0f\x1e\xfa"


def readelf(program, path, *options):
    return subprocess.run([program, "-W", *options, path], capture_output=True, text=True,
                          check=True).stdout


def is_elf(path):
    with open(path, "rb") as file:
        return file.read(4) == b"\x7fELF"


class ElfFile:
    def __init__(self, program, path):
        self.path = path
        with open(path, "rb") as file:
            self.bytes = file.read()
        self.segments = re.findall(r"^  (\w+) +(0x\w+) (0x\w+) 0x\w+ (0x\w+) 0x\w+ ([RWE ]{3}) ",
                                   readelf(program, path, "-l"), re.MULTILINE)
        self.dynamic = readelf(program, path, "-d")
        self.notes = readelf(program, path, "-n")
        self.header = readelf(program, path, "-h")
        self.imports, self.exports = set(), {}
        for line in readelf(program, path, "--dyn-syms").splitlines():
            words = line.split()
            if len(words) < 8 or not words[0].endswith(":") or words[3] not in ("FUNC", "OBJECT", "NOTYPE"):
                continue
            name = words[7].split("@")[0]
            if words[6] == "UND":
                self.imports.add(name)
            elif words[4] in ("GLOBAL", "WEAK", "UNIQUE"):
                self.exports[name] = (words[3], int(words[1], 16))

    def flags_of(self, segment):
        return [flags for kind, *_, flags in self.segments if kind == segment]

    def at(self, address, size):
        """Returns the bytes that the file has at an address."""
        for kind, offset, begin, length, _ in self.segments:
            begin = int(begin, 16)
            if kind == "LOAD" and begin <= address < begin + int(length, 16):
                start = int(offset, 16) + address - begin
                return self.bytes[start:start + size]
        return b""

    def link_problems(self):
        """Returns what the link flags should have given and did not."""
        problems = []
        if not self.flags_of("GNU_RELRO"):
            problems.append("no GNU_RELRO: relocations stay writable")
        if not re.search(r"\(BIND_NOW\)|\(FLAGS_1\).*\bNOW\b|\(FLAGS\).*BIND_NOW", self.dynamic):
            problems.append("no BIND_NOW: the procedure linkage table stays writable")
        stack = self.flags_of("GNU_STACK")
        if not stack or "E" in stack[0]:
            problems.append("the stack is executable")
        if any("W" in flags and "E" in flags for flags in self.flags_of("LOAD")):
            problems.append("a segment is writable and executable")
        if "TEXTREL" in self.dynamic:
            problems.append("relocations in the code")
        if not re.search(r"Type: +DYN", self.header):
            problems.append("not position-independent")
        for kind, folders in re.findall(r"\((RPATH|RUNPATH)\) +Library \w+: \[(.*)\]", self.dynamic):
            if any(folder and not folder.startswith(("/", "$ORIGIN")) for folder in folders.split(":")):
                problems.append(f"{kind} with a relative folder: {folders}")
        return problems

    def has_stack_protector(self):
        return "__stack_chk_fail" in self.imports

    def fortified(self):
        return sorted(name for name in self.imports if re.fullmatch(r"__\w+_chk", name))

    def has_branch_property(self):
        """Whether the loader enables CET for the file: all linked objects have the property."""
        return bool(re.search(r"x86 feature: .*IBT.*SHSTK", self.notes))

    def unmarked_exports(self):
        """Exported functions that an indirect call could not reach with CET."""
        return sorted(name for name, (kind, address) in self.exports.items()
                      if kind == "FUNC" and self.at(address, 4) != ENDBR64)
