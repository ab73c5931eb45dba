"""Elements of a page; whatever is not made by `tag` is escaped, so that nothing slips through."""

from __future__ import annotations

import html
from collections.abc import Iterable, Sequence

from evcalib.display import visible

VOID = ("img", "meta", "br")


class Html(str):
    """Text that is HTML already."""


def escape(text: object) -> Html:
    """Return any text as HTML that shows it, with a mark for what no page can hold."""
    if isinstance(text, Html):
        return text
    return Html(html.escape(visible(str(text))))


def join(parts: Iterable[object]) -> Html:
    """Return parts one after the other, escaped where they are plain text."""
    return Html("".join(escape(part) for part in parts))


def tag(name: str, /, *inside: object, **attributes: str) -> Html:
    """Return an element; ``class_`` stands for the attribute ``class``."""
    listed = "".join(
        f' {key.rstrip("_")}="{escape(str(value))}"' for key, value in attributes.items()
    )
    if name in VOID:
        return Html(f"<{name}{listed}>")
    return Html(f"<{name}{listed}>{join(inside)}</{name}>")


def table(rows: Iterable[Sequence[object]], head: Sequence[str] = ()) -> Html:
    """Return a table whose first column names its rows; wide ones scroll in their own box."""
    top = tag("thead", tag("tr", *(tag("th", name, scope="col") for name in head))) if head else ""
    body = [
        tag("tr", tag("th", first, scope="row"), *(tag("td", cell) for cell in rest))
        for first, *rest in rows
    ]
    return tag("div", tag("table", Html(top), tag("tbody", *body)), class_="scroll")


def section(title: str, *inside: object) -> Html:
    """Return a part of the page under a heading."""
    return tag("section", tag("h2", title), *inside)


def page(title: str, style: str, *inside: object) -> str:
    """Return the whole document; `style` is CSS and goes in as it is."""
    head = tag(
        "head",
        tag("meta", charset="utf-8"),
        tag("meta", name="viewport", content="width=device-width, initial-scale=1"),
        tag("meta", name="color-scheme", content="light dark"),
        tag("title", title),
        tag("style", Html(style)),
    )
    body = tag("body", tag("main", *inside))
    return f'<!DOCTYPE html>\n<html lang="en">\n{head}\n{body}\n</html>\n'
