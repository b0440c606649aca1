"""What is shown while tracking: a view of the messages of a session, on a terminal, as lines, or as JSON."""

import sys
from collections import deque
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Self

from emsid.cli.interruption import print_notice
from emsid.cli.terminal import plain_table, say, say_json
from emsid.units import plain_unit, with_unit

if TYPE_CHECKING:
    from rich.console import RenderableType
    from rich.live import Live

    from emsid.findings import Finding

Message = dict[str, Any]
LINES = 5
"""The number of findings that stay on the screen."""
BARS = "▁▂▃▄▅▆▇█"
WIDTH = 60
"""The number of outputs in the line of bars."""


class View:
    """Shows messages; this base class shows only the answer to Ctrl-C."""

    def show(self, message: Message) -> None:
        """Show one."""

    def notify(self, answer: str) -> None:
        """Show the answer to Ctrl-C; safe in a handler of a signal."""
        print_notice(answer)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *problem: object) -> None:
        pass


def view_of(json: bool, option: Callable[[str], str]) -> View:
    """JSON lines, a live view of a terminal, or plain lines where there is none."""
    if json:
        return JsonLines()
    return Screen(option) if sys.stdout.isatty() else Lines(option)


class JsonLines(View):
    """Every message as one line of JSON."""

    def show(self, message: Message) -> None:
        """See `View.show`."""
        import msgspec

        say_json(msgspec.json.encode(message) + b"\n")


class Lines(View):
    """Findings as they come, and the last estimate as a table."""

    def __init__(self, option: Callable[[str], str]) -> None:
        self._option = option
        self._start: Message = {}
        self._last: Message = {}

    def show(self, message: Message) -> None:
        """See `View.show`."""
        if message["kind"] == "start":
            self._start = message
            say(heading(message))
        elif message["kind"] == "estimate":
            self._last = message
        elif message["kind"] == "finding":
            say(words_of(message, self._option))
        elif message["kind"] == "end" and self._last:
            from emsid.cli.terminal import show

            say(counts(self._last))
            for table in tables(self._last, self._start):
                show(table)


class Screen(Lines):
    """A screen that changes in place, and stays with its last content."""

    def __init__(self, option: Callable[[str], str]) -> None:
        super().__init__(option)
        self._found: deque[str] = deque(maxlen=LINES)
        self._outputs: deque[float] = deque(maxlen=WIDTH)
        self._live: Live | None = None

    def show(self, message: Message) -> None:
        """See `View.show`."""
        if message["kind"] == "start":
            self._start = message
        elif message["kind"] == "estimate":
            self._last = message
            self._outputs.append(message["output"])
        elif message["kind"] == "finding":
            self._found.append(words_of(message, self._option))
        if self._live is not None and message["kind"] != "end":
            self._live.update(self._content(), refresh=message["kind"] != "finding")

    def notify(self, answer: str) -> None:
        """Keep the answer for the last content: what is written between would be drawn over."""
        self._found.append(answer)

    def _content(self) -> "RenderableType":
        from rich.console import Group
        from rich.text import Text

        from emsid.cli.terminal import printable

        if not self._last:
            waiting = heading(self._start) if self._start else "waiting for the first sample; Ctrl-C ends"
            return Group(Text(waiting), *(Text(printable(each)) for each in self._found))
        lines = [heading(self._start), counts(self._last), signals(self._last, self._start), bars(self._outputs)]
        found = [Text(printable(each), style="yellow") for each in self._found]
        return Group(*(Text(printable(line)) for line in lines), *tables(self._last, self._start), *found)

    def __enter__(self) -> Self:
        from rich.console import Console
        from rich.live import Live

        self._live = Live(
            self._content(), console=Console(highlight=False), auto_refresh=False, vertical_overflow="crop"
        )
        self._live.start()
        return self

    def __exit__(self, *problem: object) -> None:
        if self._live is not None:
            self._live.update(self._content())
            self._live.stop()


def heading(start: Message) -> str:
    """Source, structure, rule and sample time."""
    alarm = "" if start["false_alarm"] is None else ", detects changes"
    return f"{start['source']}: {start['structure']}, {start['rule']}, dt {start['dt']:g} s{alarm}; Ctrl-C ends"


def counts(message: Message) -> str:
    """Time, rate and counts."""
    text = f"{message['time']:10.3f} s  {message['samples']} samples, {message['rate']:.0f} per s"
    for name, words in (
        ("lost", "lost"),
        ("malformed", "malformed lines"),
        ("not_finite", "not finite"),
        ("repeated", "repeated"),
        ("skipped", "not tracked"),
    ):
        if message[name] or name == "lost":
            text += f", {message[name]} {words}"
    return text


def signals(message: Message, start: Message) -> str:
    """Input, output, prediction, noise, and whether there is excitation."""
    output, measured = start["output"], f"{message['output']:.4g}"
    parts = [
        f"{channel['name']} {with_unit(f'{value:.4g}', channel['unit'])}"
        for channel, value in zip(start["inputs"], message["input"], strict=True)
    ]
    parts.append(f"{output['name']} {with_unit(measured, output['unit'])}")
    for name, words in (("prediction", "predicted one step ahead"), ("noise", "noise")):
        if message[name] is not None:
            parts.append(f"{words} {with_unit(f'{message[name]:.4g}', output['unit'])}")
    if message["model"] is not None and message["model"]["output"] is not None:
        parts.append(f"{message['model']['name']} free run {message['model']['output']:.4g}")
    if message["idle"]:
        parts.append(f"no excitation for {message['idle'] * start['dt']:.2g} s, estimate held")
    return ", ".join(parts)


def bars(outputs: "deque[float]") -> str:
    """The last outputs as a line of bars."""
    if not outputs:
        return ""
    low, high = min(outputs), max(outputs)
    size = (high - low) or 1.0
    return "".join(BARS[min(int((output - low) / size * len(BARS)), len(BARS) - 1)] for output in outputs)


def tables(message: Message, start: Message) -> "list[Any]":
    """Parameters with intervals, and physical values."""
    found = []
    meanings = dict(zip(start["parameters"], start["meanings"], strict=True))
    named = [each | {"name": f"{each['name']}: {meanings[each['name']]}"} for each in message["parameters"]]
    for title, rows in (("parameters, with 95 % intervals", named), ("motor", message["physical"])):
        lines = [
            (
                row["name"],
                f"{row['value']:.5g}" if row["value"] is not None else "–",
                f"{row['half_width']:.2g}" if row["half_width"] is not None else "",
                plain_unit(row.get("unit", "")),
            )
            for row in rows
        ]
        if lines:
            heads: Any = {title: "left", "value": "right", "±": "right", "unit": "left"}
            found.append(plain_table("", heads, lines))
    return found


def words_of(message: Message, option: Callable[[str], str]) -> str:
    """A finding of a message as a sentence."""
    from emsid.wording import sentence

    return sentence(finding_of(message), option)


def finding_of(message: Message) -> "Finding":
    """The finding in a message."""
    from emsid.findings import Finding

    return Finding(**{name: message[name] for name in ("code", "subject", "data")})
