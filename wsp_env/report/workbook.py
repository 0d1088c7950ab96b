"""Every table of a page as a sheet of an Excel file: Office Open XML (ECMA-376), the few parts that tables need.

Cells hold numbers where the page shows numbers, and text elsewhere; text is never a formula.
"""

import io
import math
import re
import textwrap
import zipfile
from collections.abc import Iterator, Sequence
from xml.sax.saxutils import escape

from wsp_env.report.parts import Facts, Section, Table

_NUMBER = re.compile(r"[+-]?\d+(\.\d+)?([eE][+-]?\d+)?")
_MOST_LETTERS = 31  # of a sheet's name, by Excel
_MOST_TEXT = 32767  # letters of a cell, by Excel
_CLEAN = re.compile(r"[\x00-\x08\x0b\x0c\x0e-\x1f\ud800-\udfff\ufffe\uffff]")  # no part of XML 1.0
_MAIN = "http://schemas.openxmlformats.org/spreadsheetml/2006/main"
_OFFICE = "http://schemas.openxmlformats.org/officeDocument/2006/relationships"
_PACKAGE = "http://schemas.openxmlformats.org/package/2006"
_SHEET = "application/vnd.openxmlformats-officedocument.spreadsheetml"
_XML = '<?xml version="1.0" encoding="UTF-8" standalone="yes"?>'


def workbook(sections: Sequence[Section]) -> bytes:
    """Return the file; what is said beside labels is the first sheet."""
    sheets = _named(list(_sheets(sections)) or [("Nothing", [("no table on this page",)])])
    numbers = range(1, len(sheets) + 1)
    parts = "".join(f'<Override PartName="/xl/worksheets/sheet{i}.xml" ContentType="{_SHEET}.worksheet+xml"/>' for i in numbers)
    listed = "".join(
        f'<sheet name="{_text(name)}" sheetId="{i}" r:id="rId{i}"/>' for i, (name, _) in enumerate(sheets, start=1)
    )
    related = "".join(
        f'<Relationship Id="rId{i}" Type="{_OFFICE}/worksheet" Target="worksheets/sheet{i}.xml"/>' for i in numbers
    )
    files = {
        "[Content_Types].xml": f'<Types xmlns="{_PACKAGE}/content-types"><Default Extension="rels" '
        f'ContentType="application/vnd.openxmlformats-package.relationships+xml"/><Default Extension="xml" '
        f'ContentType="application/xml"/><Override PartName="/xl/workbook.xml" ContentType="{_SHEET}.sheet.main+xml"/>'
        f"{parts}</Types>",
        "_rels/.rels": f'<Relationships xmlns="{_PACKAGE}/relationships"><Relationship Id="rId1" '
        f'Type="{_OFFICE}/officeDocument" Target="xl/workbook.xml"/></Relationships>',
        "xl/workbook.xml": f'<workbook xmlns="{_MAIN}" xmlns:r="{_OFFICE}"><sheets>{listed}</sheets></workbook>',
        "xl/_rels/workbook.xml.rels": f'<Relationships xmlns="{_PACKAGE}/relationships">{related}</Relationships>',
    } | {f"xl/worksheets/sheet{i}.xml": _sheet(rows) for i, (_, rows) in enumerate(sheets, start=1)}
    target = io.BytesIO()
    with zipfile.ZipFile(target, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in files.items():
            archive.writestr(zipfile.ZipInfo(name), _XML + content, zipfile.ZIP_DEFLATED)  # of no date: same page, same file
    return target.getvalue()


def _sheets(sections: Sequence[Section]) -> Iterator[tuple[str, list[Sequence[str]]]]:
    for section in sections:
        for one in section.shows:
            if isinstance(one, Facts):
                yield section.title or "Summary", list(one.rows)
            elif isinstance(one, Table):
                yield section.title or "Table", [one.header, *one.rows, *([("",), (one.caption,)] if one.caption else [])]


def _named(sheets: list[tuple[str, list[Sequence[str]]]]) -> list[tuple[str, list[Sequence[str]]]]:
    """Give sheets names that Excel takes: short, unique whatever their case, without some letters."""
    taken: set[str] = set()
    result = []
    for title, rows in sheets:
        short = " ".join(re.sub(r"[\[\]:*?/\\']", " ", _CLEAN.sub("", title)).split()) or "Table"
        name, count = _cut(short, _MOST_LETTERS), 1
        while name.lower() in taken:
            count += 1
            name = f"{_cut(short, _MOST_LETTERS - 4)} {count}"
        taken.add(name.lower())
        result.append((name, rows))
    return result


def _cut(text: str, most: int) -> str:
    """Return the first whole words, or as much of one that is too long."""
    return textwrap.shorten(text, most, placeholder="").rstrip(" ,;") or text[:most]


def _sheet(rows: Sequence[Sequence[str]]) -> str:
    lines = "".join(f"<row>{''.join(map(_cell, cells))}</row>" for cells in rows)
    return f'<worksheet xmlns="{_MAIN}"><sheetData>{lines}</sheetData></worksheet>'


def _cell(cell: str) -> str:
    text = str(cell)
    if _NUMBER.fullmatch(text) and math.isfinite(float(text)):
        return f"<c><v>{text}</v></c>"
    return f'<c t="inlineStr"><is><t xml:space="preserve">{_text(text[:_MOST_TEXT])}</t></is></c>'


def _text(text: str) -> str:
    return escape(_CLEAN.sub("?", text), {'"': "&quot;"})
