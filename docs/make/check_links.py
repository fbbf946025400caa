"""Every link of the built site: `python docs/make/check_links.py FOLDER [--external]`.

Links within the site have to lead to a page and to a place on it; what the pages themselves fetch (scripts, styles,
pictures, fonts) has to be part of the site. Links to elsewhere are counted, and listed with `--external`: not followed.
"""

from __future__ import annotations

import sys
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit


class Page(HTMLParser):
    """The places of a page, what it links to, and what it fetches."""

    def __init__(self) -> None:
        super().__init__()
        self.places: set[str] = set()
        self.links: list[str] = []
        self.fetched: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Collect."""
        known = dict(attrs)
        self.places |= {value for key in ("id", "name") if (value := known.get(key))}
        if tag == "a" and known.get("href"):
            self.links.append(str(known["href"]))
        if tag in ("script", "img", "iframe", "source") and known.get("src"):
            self.fetched.append(str(known["src"]))
        if tag == "link" and known.get("href") and known.get("rel") in ("stylesheet", "icon", "preload"):
            self.fetched.append(str(known["href"]))


def check(folder: Path) -> tuple[list[str], list[str]]:
    """What is wrong, a line each; links to elsewhere."""
    pages: dict[Path, Page] = {}
    for path in sorted(folder.rglob("*.html")):
        page = pages[path.resolve()] = Page()
        page.feed(path.read_text(encoding="utf-8"))
    wrong, elsewhere = [], set()
    for path, page in pages.items():
        name = path.relative_to(folder.resolve())
        for url in page.fetched:
            split = urlsplit(url)
            if split.scheme not in ("", "data") or split.netloc:
                wrong.append(f"{name} fetches {url}")
            elif not split.scheme and not (path.parent / unquote(split.path)).is_file():
                wrong.append(f"{name} fetches {url}, which is not there")
        for url in page.links:
            split = urlsplit(url)
            if split.scheme or split.netloc:
                elsewhere.add(url)
                continue
            target = (path.parent / unquote(split.path)).resolve() if split.path else path
            if not target.exists():
                wrong.append(f"{name} links to {url}, which is not there")
            elif target in pages and split.fragment and unquote(split.fragment) not in pages[target].places:
                wrong.append(f"{name} links to {url}: no such place on that page")
    return wrong, sorted(elsewhere)


def main(arguments: list[str]) -> int:
    """Say what is wrong; 1 where anything is."""
    wrong, elsewhere = check(Path(arguments[0]))
    sys.stdout.write("".join(f"{line}\n" for line in wrong))
    if "--external" in arguments:
        sys.stdout.write("".join(f"{url}\n" for url in elsewhere))
    sys.stdout.write(f"{len(wrong)} links are wrong; {len(elsewhere)} lead elsewhere and were not followed\n")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
