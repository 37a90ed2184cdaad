"""Links of the documentation: each leads to a page and an anchor that exist, and each page is reached."""

import re
from urllib.parse import unquote, urlsplit

import pytest
from docs.built_site import DOCS, ROOT

pytestmark = pytest.mark.slow

EXTERNAL = re.compile(r"^(https?|mailto|data):")


def test_internal_links_and_images_resolve(site):
    anchors = {}
    broken = []
    for name, page in site.pages.items():
        path = site.folder / f"{name}.html"
        for target in page.xpath("//@href | //@src"):
            if EXTERNAL.match(target):
                continue
            parts = urlsplit(target)
            file = (path.parent / unquote(parts.path)).resolve() if parts.path else path.resolve()
            if not file.is_file():
                broken.append(f"{name}: {target}")
            elif parts.fragment and file.suffix == ".html":
                if file not in anchors:
                    anchors[file] = {*site.parse(file).xpath("//@id | //a/@name")}
                if unquote(parts.fragment) not in anchors[file]:
                    broken.append(f"{name}: {target}")
    assert not broken


def test_links_of_files_at_the_root_resolve(site):
    """Files that readers see in the repository; the anchors are those of the built pages."""
    for source in (ROOT / "README.md", ROOT / "CONTRIBUTING.md", ROOT / "CHANGELOG.md", ROOT / "test" / "README.md"):
        text = source.read_text(encoding="utf-8")
        targets = [target for target in re.findall(r"\]\(([^)\s]+)\)", text) if not EXTERNAL.match(target)]
        assert targets or source.parent != ROOT
        for target in targets:
            path, _, anchor = target.partition("#")
            file = source.parent / path
            assert file.exists(), f"{source.name}: {target}"
            if anchor:
                page = site.pages[str(file.resolve().relative_to(DOCS).with_suffix(""))]
                assert page.xpath("//*[@id=$name]", name=anchor), f"{source.name}: {target}"


def test_links_were_checked(site):
    links = [target for page in site.pages.values() for target in page.xpath("//article//@href")]
    assert sum(not EXTERNAL.match(target) for target in links) > 100


def test_every_page_is_reached_from_the_front_page(site):
    reached = {"index"}
    pending = ["index"]
    while pending:
        name = pending.pop()
        for target in site.pages[name].xpath("//article//@href | //*[contains(@class, 'sidebar-tree')]//@href"):
            if EXTERNAL.match(target) or not urlsplit(target).path:
                continue
            file = (site.folder / f"{name}.html").parent / unquote(urlsplit(target).path)
            linked = str(file.resolve().relative_to(site.folder.resolve()).with_suffix(""))
            if linked in site.pages and linked not in reached:
                reached.add(linked)
                pending.append(linked)
    assert reached == set(site.pages)


def test_index_of_each_section_links_each_of_its_pages_in_the_text(site):
    for section in ("tutorials", "how_to", "reference", "explanation"):
        names = {path.stem for path in (DOCS / section).glob("*.md")} - {"index"}
        article = site.article(f"{section}/index")
        targets = {urlsplit(target).path for target in article.xpath(".//li//a/@href")}
        assert {f"{name}.html" for name in names} <= targets


def test_pages_load_nothing_from_a_network(site):
    loaded = "//script/@src | //link[@rel='stylesheet']/@href | //img/@src | //iframe/@src"
    for name, page in site.pages.items():
        assert not [target for target in page.xpath(loaded) if re.match(r"^(https?:)?//", target)], name
