"""The words of an Abaqus input file: keywords with their parameters, data lines, included files; and what its element types are."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field

from taichi_membrane.mesh.formats.raw import SECOND_ORDER, CellKind
from taichi_membrane.mesh.formats.source import Includes, Source, shown

# What an element type is, by its letters. Suffixes say how it is computed (R reduced, H hybrid, T temperature, …).
_TYPES: tuple[tuple[CellKind, str], ...] = (
    ("triangle", r"S3(R|RS|T|RT)?|STRI3|M3D3|CPS3(T|E)?|CPE3(H|T|E)?|CPEG3(H|T)?|SFM3D3|R3D3"),
    ("quad", r"S4(R|RS|RSW|R5|T|RT)?|M3D4R?|CPS4(R|I|T|RT|E)?|CPE4\w*|CPEG4\w*|SFM3D4R?|R3D4"),
    ("line", r"T[23]D2(H|T|E)?|B[23][13](H|OS|OSH)?|B[23]3H?|PIPE[23]1H?"),
    ("vertex", r"MASS|ROTARYI"),
)
_ALLOWED = (
    "triangles S3, S3R, STRI3, M3D3, CPS3, CPE3, R3D3; quadrilaterals S4, S4R, M3D4, M3D4R, CPS4, CPE4, R3D4; lines T3D2, "
    "B31, B33; points MASS, ROTARYI"
)
_SECOND_ORDER = re.compile(
    r"STRI65|S[89]R?5?T?|M3D[689]R?|SFM3D[68]R?|CP[SE]G?[68]\w*|T[23]D3\w*|B[23]2\w*|PIPE[23]2\w*"
)
# Types that have no stiffness of their own: read for their shape, and said so.
SHAPES_ONLY = re.compile(r"SFM3D\w+|R3D\d")
# Keywords that make or move nodes or elements: left out, the mesh would be another.
GENERATES = {
    "NGEN": "write the nodes out",
    "NFILL": "write the nodes out",
    "NCOPY": "write the nodes out",
    "NMAP": "write the nodes out",
    "ELGEN": "write the elements out",
    "ELCOPY": "write the elements out",
    "PARAMETER": "write the numbers out",
    "IMPERFECTION": "write the nodes where they are",
    "SYMMETRICMODELGENERATION": "write the whole model out",
    "IMPORT": "write the mesh into the file",
    "SUBSTRUCTUREGENERATE": "write the mesh out",
    "ADAPTIVEMESHREFINEMENT": "write the mesh out",
}
# Keywords without meaning for a mesh; all others that are left out are named.
SILENT = frozenset(
    ("HEADING", "PREPRINT", "RESTART", "OUTPUT", "NODEOUTPUT", "ELEMENTOUTPUT", "CONTACTOUTPUT", "ENERGYOUTPUT", "NODEPRINT",
     "ELPRINT", "NODEFILE", "ELFILE", "FILEFORMAT", "MONITOR", "PRINT", "STEP", "ENDSTEP", "STATIC", "DYNAMIC", "CONTROLS",
     "FILEOUTPUT", "INCREMENTATION", "END")
)  # fmt: skip

# Parameters of the keywords that are read; any other could change what they mean.
_PARAMETERS: dict[str, tuple[str, ...]] = {
    "NODE": ("NSET", "INPUT", "SYSTEM"),
    "ELEMENT": ("TYPE", "ELSET", "INPUT"),
    "NSET": ("NSET", "ELSET", "GENERATE", "INSTANCE", "INTERNAL", "UNSORTED"),
    "ELSET": ("ELSET", "GENERATE", "INSTANCE", "INTERNAL", "UNSORTED"),
    "PART": ("NAME",),
    "INSTANCE": ("NAME", "PART", "LIBRARY", "INSTANCE"),
    "INCLUDE": ("INPUT",),
}


def element_kind(name: str, source: Source, line: int) -> CellKind:
    """What an element type is.

    :raises InputError: it has no place in a mesh of triangles.
    """
    for kind, pattern in _TYPES:
        if re.fullmatch(pattern, name):
            return kind
    if _SECOND_ORDER.fullmatch(name):
        raise source.fault(f"element type {shown(name)}: {SECOND_ORDER}", line)
    raise source.fault(f"element type {shown(name)} is not one that is read: {_ALLOWED}", line)


@dataclass(frozen=True, eq=False)
class Keyword:
    """A keyword with its parameters (names in capitals without blanks, values as written) and its data lines.

    :param data: the line's words between commas, with source and number of the line.
    """

    name: str
    parameters: dict[str, str]
    source: Source
    line: int
    data: list[tuple[list[str], Source, int]] = field(default_factory=list)

    def need(self, parameter: str) -> str:
        """A parameter's value.

        :raises InputError: the keyword has none.
        """
        value = self.parameters.get(parameter, "")
        if not value:
            raise self.source.fault(f"*{self.name} needs {parameter} = …", self.line)
        return value


def keywords(source: Source) -> Iterator[Keyword]:
    """All keywords in order, those of included files at their places. Data before the first keyword is refused."""
    found: Keyword | None = None
    for name, parameters, at, line, words in _lines(source, Includes(source)):
        if name is not None:
            if found is not None:
                yield found
            found = Keyword(name, parameters, at, line)
        elif found is None:
            told = f"data stand before the first keyword: {shown(','.join(words))}"
            raise at.fault(f"{told}; keywords begin with a star (a UCD file of AVS is read as .avs)", line)
        elif found.name != "HEADING":
            found.data.append((words, at, line))
    if found is not None:
        yield found


_Line = tuple[str | None, dict[str, str], Source, int, list[str]]


def _lines(source: Source, includes: Includes) -> Iterator[_Line]:
    number = 0
    while number < len(source.lines):
        line, text = number + 1, source.lines[number].strip()
        number += 1
        if text.startswith("**") or not text:
            continue
        if not text.startswith("*"):
            yield None, {}, source, line, [word.strip() for word in text.split(",")]
            continue
        while text.endswith(",") and number < len(source.lines):  # a keyword goes on where its line ends with a comma
            follows = source.lines[number].strip()
            if follows.startswith("*") and not follows.startswith("**"):
                break
            number += 1
            text += follows if not follows.startswith("**") else ""
        name, parameters = _keyword(text, source, line)
        if name == "INCLUDE":
            yield from _lines(includes.enter(parameters.get("INPUT", ""), source, line), includes)
            includes.leave()
            continue
        yield name, parameters, source, line, []
        if parameters.get("INPUT"):
            yield from _data_file(includes.enter(parameters["INPUT"], source, line))
            includes.leave()


def _data_file(source: Source) -> Iterator[_Line]:
    """The data lines of a keyword that stand in a file of their own."""
    for line, text in enumerate(map(str.strip, source.lines), 1):
        if text.startswith("*") and not text.startswith("**"):
            raise source.fault(f"data lines are expected, this is a keyword: {shown(text)}", line)
        if text and not text.startswith("**"):
            yield None, {}, source, line, [word.strip() for word in text.split(",")]


def _keyword(text: str, source: Source, line: int) -> tuple[str, dict[str, str]]:
    """Name without blanks in capitals, parameters; commas inside quotation marks separate nothing."""
    head, *rest = re.findall(r'(?:[^,"]|"[^"]*"?)+', text)
    name = re.sub(r"\s+", "", head[1:]).upper()
    if "=" in name:
        raise source.fault(f"a comma is missing between keyword and parameter: {shown(head.strip())}", line)
    parameters: dict[str, str] = {}
    for part in rest:
        key, equals, value = part.partition("=")
        key = _parameter(name, re.sub(r"\s+", "", key).upper(), source, line)
        if key in parameters:
            raise source.fault(f"the parameter {key} is given twice", line)
        if key:
            parameters[key] = value.strip().strip('"') if equals else ""
    return name, parameters


def _parameter(name: str, key: str, source: Source, line: int) -> str:
    """The full name of a parameter, which may be shortened as long as it is one alone.

    :raises InputError: the keyword has no such parameter.
    """
    allowed = _PARAMETERS.get(name, ())
    if not allowed or not key or key in allowed:
        return key
    meant = [word for word in allowed if len(key) >= 3 and word.startswith(key)]
    if len(meant) != 1:
        raise source.fault(f"*{name}: the parameter {shown(key)} is not read; allowed: {', '.join(allowed)}", line)
    return meant[0]
