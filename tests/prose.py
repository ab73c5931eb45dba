"""The documents of this repository, and what they refer to: links, names in the code, commands."""

import importlib
import inspect
import re
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import jupytext
import typer.main
from markdown_it import MarkdownIt
from markdown_it.token import Token

ROOT = Path(__file__).parents[1]
NOTEBOOKS = sorted((ROOT / "notebooks").glob("[0-9]*.py"))
PAGES = sorted([*ROOT.glob("*.md"), *ROOT.glob("*/*.md")])
NAME = re.compile(r"(?:evcalib|data_tools)(?:\.\w+)+")
COMMAND = re.compile(r"evcalib(?: +[\w-]+)?(?: .*)?")
OPTION = re.compile(r"(?<![\w-])--?[a-z][\w-]*")


@dataclass(frozen=True)
class Document:
    """A page, or the text of a notebook.

    Attributes
    ----------
    path : Path
        Where links start from: the page, or the stored notebook.
    text : str
        Markdown.
    """

    path: Path
    text: str

    def tokens(self) -> list[Token]:
        """Return all tokens, those inside paragraphs too."""
        blocks = MarkdownIt("commonmark").enable("table").parse(self.text)
        return [token for block in blocks for token in (block, *(block.children or ()))]

    def links(self) -> list[tuple[str, str]]:
        """Return the text and the target of each link and picture."""
        found, inside, open_at = [], [], None
        for token in self.tokens():
            if token.type == "link_open":
                inside, open_at = [], token.attrGet("href")
            elif token.type == "link_close":
                found.append(("".join(inside), str(open_at)))
                open_at = None
            elif open_at is not None:
                inside.append(token.content)
            if token.type == "image":
                found.append((token.content, str(token.attrGet("src"))))
            if token.type in ("html_block", "html_inline"):
                found += [
                    ("", target) for target in re.findall(r'(?:href|src)="(.+?)"', token.content)
                ]
        return found

    def code(self) -> list[str]:
        """Return what stands between single backticks."""
        return [token.content for token in self.tokens() if token.type == "code_inline"]

    def lonely_items(self) -> list[str]:
        """Return numbered lists of a single item: a line that happens to begin with "1."."""
        tokens = self.tokens()
        opened = [k for k, token in enumerate(tokens) if token.type == "ordered_list_open"]
        found = []
        for start in opened:
            level = tokens[start].level
            end = next(
                k
                for k in range(start, len(tokens))
                if tokens[k].type == "ordered_list_close" and tokens[k].level == level
            )
            items = [
                t for t in tokens[start:end] if t.type == "list_item_open" and t.level == level + 1
            ]
            if len(items) == 1:
                found.append(next(t.content for t in tokens[start:] if t.type == "inline"))
        return found

    def commands(self) -> list[str]:
        """Return the lines that call our command, from shell blocks and from the text."""
        blocks = [t.content for t in self.tokens() if t.type == "fence" and t.info == "sh"]
        lines = "\n".join(blocks).replace("\\\n", " ").splitlines()
        parts = [part.split("#")[0].strip() for line in lines for part in line.split("&&")]
        return [part for part in (*parts, *self.code()) if COMMAND.fullmatch(part)]

    def anchors(self) -> set[str]:
        """Return the names of its headings, as code hosts make them."""
        tokens = self.tokens()
        titles = [tokens[k + 1].content for k, t in enumerate(tokens) if t.type == "heading_open"]
        return {re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-") for title in titles}


@cache
def documents() -> list[Document]:
    """Return all pages and the text of all notebooks."""
    pages = [Document(path, path.read_text(encoding="utf-8")) for path in PAGES]
    return pages + [Document(path.with_suffix(".ipynb"), markdown_of(path)) for path in NOTEBOOKS]


def markdown_of(source: Path) -> str:
    """Return the text of a notebook."""
    cells = jupytext.read(source).cells
    return "\n\n".join(cell.source for cell in cells if cell.cell_type == "markdown")


def broken_link(document: Document, target: str) -> str | None:
    """Return what is wrong with a target of a link; None if nothing is.

    Addresses of other places are looked at, not opened.
    """
    if "://" in target or target.startswith("mailto:"):
        return None if re.fullmatch(r"https://[\w.-]+\.\w+(/\S*)?", target) else "no https address"
    name, _, anchor = target.partition("#")
    path = (document.path.parent / name).resolve() if name else document.path
    if not path.is_relative_to(ROOT) or not path.exists():
        return "leads nowhere"
    if not anchor:
        return None
    if line := re.fullmatch(r"L(\d+)", anchor):
        lines = len(path.read_text(encoding="utf-8").splitlines())
        return None if int(line[1]) <= lines else f"has {lines} lines only"
    anchors = next((page.anchors() for page in documents() if page.path == path), set())
    return None if anchor in anchors else "has no such heading"


def find(name: str):
    """Return what a dotted name of ours stands for.

    Raises
    ------
    AttributeError, ImportError
        If there is no such thing.
    """
    words = name.split(".")
    for count in range(len(words), 0, -1):
        try:
            thing = importlib.import_module(".".join(words[:count]))
        except ModuleNotFoundError as error:
            if error.name is None or not name.startswith(error.name):
                raise
            continue
        for word in words[count:]:
            thing = getattr(thing, word)
        return thing
    raise ImportError(name)


def source_of(thing) -> Path:
    """Return the file that defines a module, class or function."""
    return Path(inspect.getsourcefile(inspect.unwrap(thing)) or "").resolve()


def wrong_command(command: str) -> str | None:
    """Return what is wrong with a call of our command; None if nothing is."""
    from data_tools import cli

    group = typer.main.get_command(cli.app)
    words = command.split()
    if len(words) < 2 or words[1].startswith("-"):
        return None
    called = group.commands.get(words[1])
    if called is None:
        return f"no command {words[1]}"
    known = {option for p in called.params for option in (*p.opts, *p.secondary_opts)} | {"--help"}
    unknown = [option for option in OPTION.findall(command) if option not in known]
    return f"no options {unknown}" if unknown else None
