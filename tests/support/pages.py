"""A page as the tests read it."""

import re
from html.parser import HTMLParser

BLOCKS = {"dd", "dt", "div", "h2", "p", "td", "th", "tr"}
VOID = {"meta", "br", "link", "img"}
REFERENCE = re.compile(r"url\(([^)]*)\)")


class Page(HTMLParser):
    """Elements of a page in their order, each with attributes and text; wrong nesting is an error."""

    def __init__(self, file):
        super().__init__(convert_charrefs=True)
        self.elements = []
        self._open = []
        # a space at which no line ends is read as any other
        self.text = file.read_text(encoding="utf-8").replace("\u00a0", " ")
        self.feed(self.text)
        self.close()
        assert not self._open

    def handle_starttag(self, tag, attributes):
        assert len(dict(attributes)) == len(attributes)
        element = {"tag": tag, "text": "", "inside": [one["tag"] for one in self._open], **dict(attributes)}
        self.elements.append(element)
        if tag not in VOID:
            self._open.append(element)

    def handle_startendtag(self, tag, attributes):
        self.handle_starttag(tag, attributes)
        if tag not in VOID:
            self._open.pop()

    def handle_endtag(self, tag):
        if tag in BLOCKS:
            self.handle_data(" ")
        assert self._open.pop()["tag"] == tag

    def handle_data(self, text):
        for element in self._open:
            element["text"] += text

    def all(self, tag):
        return [element for element in self.elements if element["tag"] == tag]

    def texts(self, tag):
        return [" ".join(element["text"].split()) for element in self.all(tag)]

    @property
    def sections(self):
        return [element["id"] for element in self.all("section")]

    def section(self, name):
        """The text of a section."""
        return next(" ".join(one["text"].split()) for one in self.all("section") if one["id"] == name)

    def facts(self):
        """The facts by name: value and remark."""
        groups = re.findall(r"<div><dt>(.*?)</dt><dd>(.*?)</dd>(?:<dd class=\"remark\">(.*?)</dd>)?</div>", self.text)
        return {name: (value, remark) for name, value, remark in groups}

    def tables(self):
        """Of each table by its caption, or without one by its first head: the rows by name, each with its heads."""
        found = {}
        for table in re.findall(r"<table>(.*?)</table>", self.text, re.S):
            caption = re.search(r"<caption>(.*?)</caption>", table)
            heads = re.findall(r"<th[^>]*>(.*?)</th>", table)
            rows = [
                [re.sub(r"<[^>]*>", "", cell) for cell in re.findall(r"<td[^>]*>(.*?)</td>", row)]
                for row in re.findall(r"<tr>(.*?)</tr>", table.partition("<tbody>")[2], re.S)
            ]
            found[caption[1] if caption else heads[0]] = {
                row[0]: dict(zip(heads[1:], row[1:], strict=True)) for row in rows
            }
        return found

    def rows(self):
        """The cells of the rows of all tables, as text."""
        cells = re.findall(r"<tr>(.*?)</tr>", self.text, re.S)
        return [[re.sub(r"<[^>]*>", "", cell) for cell in re.findall(r"<td[^>]*>(.*?)</td>", row)] for row in cells]

    def check(self):
        """Hold the page to what holds for every page."""
        ids = [element["id"] for element in self.elements if "id" in element]
        assert len(set(ids)) == len(ids)
        for element in self.elements:
            if element["tag"] == "script":  # of the page's own
                assert set(element) - {"tag", "text", "inside"} <= {"type", "id"}
            assert element["tag"] not in {"link", "iframe", "object", "embed", "base", "form"}
            for key, value in element.items():
                if key in {"tag", "text", "inside"} or value is None:
                    continue
                assert not key.startswith("on")
                references = REFERENCE.findall(value)
                if key in {"href", "src", "xlink:href", "data", "poster", "srcset"}:
                    references.append(value)
                for reference in references:
                    assert reference[1:] in ids if reference.startswith("#") else reference.startswith("data:"), (
                        reference
                    )
                if key in {"aria-labelledby"}:
                    assert value in ids
                assert "http:" not in value
                assert "https:" not in value
        for style in self.texts("style"):
            assert "url(" not in style
            assert "@import" not in style
        titles = {one["id"]: one["text"] for one in self.all("title") if "id" in one}
        figures = self.all("svg")
        assert len(figures) == len(self.all("figure"))
        for figure in figures:
            assert figure["role"] == "img"
            assert titles[figure["aria-labelledby"]].strip()
