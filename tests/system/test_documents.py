# SPDX-License-Identifier: Apache-2.0
"""The pages: README's length, links that lead somewhere, an index that names every page."""

import re
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).resolve().parents[2]
PAGES = [
    *ROOT.glob("*.md"),
    *sorted((ROOT / "docs").rglob("*.md")),
    *sorted((ROOT / "examples").glob("*.md")),
]
README_LINES = 150
LINK = re.compile(r"\[[^\]]*\]\(([^)\s]+)\)")
FENCE = re.compile(r"^```.*?^```", re.MULTILINE | re.DOTALL)
NAMED_FILE = re.compile(r"`([\w./-]+/[\w.-]+\.(?:py|yaml|mod|proto|cal|urdf|json|rviz))`")
MADE_AT_RUN_TIME = ("build/", "bags/", "campaigns/", "share/")
KEY = re.compile(r"\[([A-Z][A-Za-z]{1,4}\d{0,4})\](?!\()")


def anchors(text):
    """Names that a page's headings have on the code host."""
    heads = re.findall(r"^#+ (.*)$", FENCE.sub("", text), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", head.lower()).strip().replace(" ", "-") for head in heads}


def broken_links(page, text):
    """Links of a page that lead nowhere in the repository."""
    found = []
    for target in LINK.findall(FENCE.sub("", text)):
        if re.match(r"[a-z]+:", target):
            continue
        path, _, anchor = target.partition("#")
        to = (page.parent / path).resolve() if path else page
        if not to.exists() or (
            anchor and anchor not in anchors(text if to == page else to.read_text())
        ):
            found.append(target)
    return found


def missing_files(text, files):
    """Files of the repository that a page names between backquotes and that are not there."""
    return [
        name
        for name in NAMED_FILE.findall(text)
        if not name.startswith(MADE_AT_RUN_TIME)
        and not any(f"/{path}".endswith(f"/{name}") for path in files)
    ]


def missing_pages(index_page, index):
    """Pages beside an index, or below it in a folder with its own, that it does not name."""
    folder = index_page.parent
    named = {(folder / t.partition("#")[0]).resolve() for t in LINK.findall(index)}
    pages = {*folder.glob("*.md"), *folder.glob("*/index.md")} - {index_page}
    return sorted(path.name for path in pages if path.resolve() not in named)


def too_long(text):
    """Whether the README is longer than a newcomer reads."""
    return len(text.splitlines()) > README_LINES


def test_readme_is_short():
    assert not too_long((ROOT / "README.md").read_text())


def test_a_long_readme_is_found():
    assert too_long("line\n" * (README_LINES + 1))
    assert not too_long("line\n" * README_LINES)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_every_link_leads_somewhere(page):
    assert broken_links(page, page.read_text()) == []


def test_a_broken_link_and_a_broken_anchor_are_found():
    text = "# One head\n[a](docs/no_such_page.md) [b](#one-head) [c](#other) [d](README.md)"
    assert broken_links(ROOT / "README.md", text) == ["docs/no_such_page.md", "#other"]


@pytest.fixture(scope="module")
def files():
    """Paths of the repository's files, relative."""
    tops = [path for path in ROOT.iterdir() if not path.name.startswith(".") and path.is_dir()]
    kept = [path for path in tops if path.name not in {"build", "install", "log"}]
    return [path.relative_to(ROOT).as_posix() for top in kept for path in top.rglob("*.*")]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_every_file_that_a_page_names_exists(page, files):
    if page.name != "CHANGELOG.md":  # which names old places, too
        assert missing_files(page.read_text(), files) == []


def test_a_file_that_is_not_there_is_found(files):
    text = "`cabols_hw/card/quanser.py`, `nodes/no_such_node.py`, `build/bench/tension.json`"
    assert missing_files(text, files) == ["nodes/no_such_node.py"]


@pytest.mark.parametrize("folder", ["docs", "docs/decisions"])
def test_the_index_names_every_page(folder):
    index = ROOT / folder / "index.md"
    assert missing_pages(index, index.read_text()) == []


def test_a_page_that_the_index_misses_is_found():
    index = ROOT / "docs" / "index.md"
    assert missing_pages(index, index.read_text().replace("(glossary.md)", "()")) == ["glossary.md"]


def citation_faults(found, version):
    """What CITATION.cff lacks of the format's demands, or says otherwise than the packages."""
    expected = {
        "cff-version": "1.2.0",
        "type": "software",
        "license": "Apache-2.0",
        "version": version,
        "authors": [{"name": "The cabols maintainers"}],
    }
    wrong = [key for key, value in expected.items() if found.get(key) != value]
    return wrong + [key for key in ("message", "title") if not isinstance(found.get(key), str)]


def package_version():
    manifest = (ROOT / "cabols_msgs" / "package.xml").read_text()
    return re.search(r"<version>(.*)</version>", manifest)[1]


def test_citation_is_valid():
    found = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    assert citation_faults(found, package_version()) == []


def test_a_citation_of_another_version_or_without_title_is_found():
    found = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    del found["title"]
    assert citation_faults({**found, "version": "9.9.9"}, "0.1.0") == ["version", "title"]


def changelog_faults(text):
    """What is not of the form of Keep a Changelog: order of versions, kinds of changes."""
    versions = re.findall(r"^## (.*)$", text, re.MULTILINE)
    wrong = [] if versions[:1] == ["Unreleased"] else ["Unreleased is not first"]
    wrong += [v for v in versions[1:] if not re.match(r"\d+\.\d+\.\d+( |$)", v)]
    kinds = {"Added", "Changed", "Deprecated", "Removed", "Fixed", "Security"}
    return wrong + [k for k in re.findall(r"^### (.*)$", text, re.MULTILINE) if k not in kinds]


def test_changelog_keeps_its_form():
    assert changelog_faults((ROOT / "CHANGELOG.md").read_text()) == []


def test_a_changelog_of_another_form_is_found():
    text = "## 0.2.0\n### News\n## soon\n### Fixed\n"
    assert changelog_faults(text) == ["Unreleased is not first", "soon", "News"]


def unlisted_keys(text, listed):
    """Keys of the literature that a page uses and the references do not list."""
    found = {key for key in KEY.findall(FENCE.sub("", text)) if re.search(r"\d|BZB|SNB", key)}
    return sorted(found - listed)


@pytest.fixture(scope="module")
def listed():
    return set(KEY.findall((ROOT / "docs" / "references.md").read_text()))


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_a_key_of_the_literature_is_in_the_references(page, listed):
    assert unlisted_keys(page.read_text(), listed) == []


def test_a_key_that_is_not_listed_is_found(listed):
    assert unlisted_keys("as [BZB] says, unlike [XYZ99]", listed) == ["XYZ99"]
