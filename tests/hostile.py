"""Texts as somebody may write them who wants more than a name, and what must not come of them."""

from html.parser import HTMLParser

from ambkit import Machine

PRINTABLE = (
    "x*/ int f(void){return 1;} /*",
    "/*/ // */*/ ??/",
    "![i](http://evil.example/x.png) [a](javascript:alert(1))",
    "<script>alert(1)</script><img src=http://evil.example/x onerror=alert(1)>",
    "</title></style></textarea>--> ]]> &lt; &#60;",
    "$\\foo$ $x `b` | **c** [red]d[/red] %{y} {{ 7*7 }} {% raw %}",
    '"; execute_process(COMMAND touch PWNED) # ${ENV} $ENV{HOME} [[ ]]',
    "_hidden\\",
    "1. # - one",
)
"""What the schema lets through: templates must make it harmless."""
NOT_PRINTABLE = (
    "x\nexecute_process(COMMAND touch PWNED)\n#",
    "x\r*/\rint f(void){return 1;}\r/*",
    "a\x1b[31mred\x1b]0;title\x07\x9b2J\x00",
    "a\u202egnp.exe\u2028b\u200b\ufffe",
)
"""What the schema refuses in a name; templates must bear it all the same."""
TEXTS = (*PRINTABLE, *NOT_PRINTABLE)


def called(bearing: Machine, text: str) -> Machine:
    """Return a bearing that has a text in all of its fields, as no file can make one."""
    return bearing.model_copy(update={"name": text, "description": text, "source": text})


class Page(HTMLParser):
    """What a page would load or run beyond itself, and how many scripts it has."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.found: list[str] = []
        self.scripts = 0
        self.text = ""  # what is to be read
        self._inside = ""
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.scripts += tag == "script"
        self._inside = tag
        if tag in ("iframe", "object", "embed", "link", "base", "form", "video", "audio"):
            self.found.append(tag)
        for name, value in attrs:
            text = value or ""
            loads = name in ("src", "srcset", "poster", "data", "background", "action")
            if name.startswith("on") or (loads and not text.startswith("data:image/")):
                self.found.append(f"{tag} {name}={text}")
            if name == "href" and not text.startswith("#"):
                self.found.append(f"{tag} {name}={text}")

    def handle_data(self, data: str) -> None:
        if self._inside not in ("script", "style"):
            self.text += data

    def handle_endtag(self, tag: str) -> None:
        self._inside = ""
