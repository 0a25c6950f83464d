"""MkDocs hooks: the README is the site's first page, and links into the repository are checked.

A page links to source files as in a checkout (``../adatracker_deploy/platform.py``). The site does not
carry them: such a link becomes the file's name, and a file that is not there fails the build.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mkdocs.exceptions import PluginError
from mkdocs.structure.files import File

if TYPE_CHECKING:
    from mkdocs.config.defaults import MkDocsConfig
    from mkdocs.structure.files import Files
    from mkdocs.structure.pages import Page

ROOT = Path(__file__).parents[1]
_LINK = re.compile(r"\[([^\]]*)\]\(((?:\.\./)[^)#]*)(#[^)]*)?\)")
_README_LINK = re.compile(r"\]\((?!https?://|#)([^)]*)\)")


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the README as ``index.md``, its links as seen from ``docs/``."""
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    seen = _README_LINK.sub(lambda link: f"]({_from_docs(link.group(1))})", readme)
    files.append(File.generated(config, "index.md", content=seen))
    return files


def on_page_markdown(markdown: str, page: Page, **_: Any) -> str:
    """Turn links out of ``docs/`` into file names.

    Raises:
        PluginError: there is no such file.
    """

    def name(link: re.Match[str]) -> str:
        text, target = link.group(1), link.group(2)
        if not (ROOT / "docs" / target).exists():
            raise PluginError(f"{page.file.src_uri}: {target} is not in the repository")
        return f"{text} (`{target.removeprefix('../')}`)" if text.strip("`") not in target else text

    return _LINK.sub(name, markdown)


def _from_docs(target: str) -> str:
    return target.removeprefix("docs/") if target.startswith("docs/") else f"../{target}"
