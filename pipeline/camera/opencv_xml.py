"""XML as OpenCV writes it, as plain tables."""

from xml.etree import ElementTree

from ..errors import InputError
from ..files.tables import check_levels


def xml_table(text: str, where: str) -> object:
    """The content of OpenCV's XML as dictionaries, lists and strings.

    Raises
    ------
    InputError
        Not XML, or with a document type, which OpenCV does not write and which can name other files.
    """
    try:
        if "<!DOCTYPE" in text:
            raise ValueError("it has a document type")
        table = _element(ElementTree.fromstring(text))
        check_levels(table)
        return table
    except (ElementTree.ParseError, ValueError, RecursionError) as error:
        raise InputError(f"{where}: expected XML as OpenCV writes it, cannot read it ({error})") from None


def _element(element: ElementTree.Element) -> object:
    if not len(element):
        return (element.text or "").strip().strip('"')
    parts: dict[str, list[object]] = {}
    for part in element:
        parts.setdefault(part.tag, []).append(_element(part))
    if list(parts) == ["_"]:
        return parts["_"]
    # of a tag that comes several times none is left out
    return {tag: found[0] if len(found) == 1 else found for tag, found in parts.items()}
