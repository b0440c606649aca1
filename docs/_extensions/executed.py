"""Run every block of Bash and Python on a page while Sphinx reads it, and show what it prints.

A page is run from top to bottom in an empty folder, in the process of Sphinx: loading compiler and libraries for every
command would take seconds each. Blocks of Python share one namespace, as the cells of a notebook do. A page whose front
matter has ``continues: NAME`` begins with the files and names with which that page ended; with ``needs: bench`` it has
this folder of the repository. A picture on a page,
``![what it shows](speed.svg)``, is the file that the commands have written, or with ``pictures: test_NAME -k WHICH``
one that these tests have taken; without the browser that they need, the page is without it. A page that they have
written is shown in a frame by ```` ```{live} result/report.html ````, with what it shows as content.

Only fences of the languages in `SHOWN` are not run. A line that fails, a warning of Python, or a program that is left
running ends the build.
"""

from __future__ import annotations

import ast
import io
import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
import warnings
from collections.abc import Iterator
from contextlib import ExitStack, chdir, contextmanager, redirect_stderr, redirect_stdout
from dataclasses import dataclass, field
from html import escape
from importlib.util import find_spec
from pathlib import Path
from typing import Any
from unittest.mock import patch

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.transforms import SphinxTransform
from sphinx.util import logging
from sphinx.util.docutils import SphinxDirective

RUN = ("bash", "python")
"""Languages of fences that are run."""
SHOWN = ("text", "c", "toml", "json", "csv", "diff", "default", "none", "matlab")
"""Languages of fences that are content of files or output, not commands."""
FENCE = re.compile(r"^(`{3,})(\w+)\n(.*?)^\1$", re.MULTILINE | re.DOTALL)
CONTINUES = re.compile(r"\A---\n.*?^continues: (\S+)$.*?^---\n", re.MULTILINE | re.DOTALL)
NEEDS = re.compile(r"\A---\n.*?^needs: (\w+)$.*?^---\n", re.MULTILINE | re.DOTALL)
"""A folder of the repository that the commands of a page use."""
PICTURES = re.compile(r"\A---\n.*?^pictures: (\w+) -k (.+)$.*?^---\n", re.MULTILINE | re.DOTALL)
"""Tests that take the pictures of a page."""
TAKES_PICTURES = ("pytest", "xdist", "hypothesis", "selenium")
"""Packages of the tests that take pictures."""
LONGEST = 60
"""Lines of output of a block that are shown; a page says so where there are more."""

log = logging.getLogger(__name__)


@dataclass
class Page:
    """A page that has been run.

    Attributes:
        folder: in which it ran, with the files that it has written.
        namespace: the names of its Python.
        printed: what every block printed.
        lines: the commands that it ran so far, where they were of emsid only.
        seconds: processor time that it took.
    """

    folder: Path
    namespace: dict[str, Any] = field(default_factory=lambda: {"__name__": "__main__"})
    printed: list[str] = field(default_factory=list)
    lines: tuple[str, ...] | None = ()
    seconds: float = 0.0


class Runner:
    """Runs pages, each once.

    Args:
        source: the folder of the pages.
        work: a folder of the build, in which every page has a folder of its own.
    """

    def __init__(self, source: Path, work: Path) -> None:
        self.source, self.work = source, work
        self.pages: dict[str, Page] = {}
        self.begun: dict[tuple[str, ...], tuple[str, Path]] = {}
        self.programs = work / "bin"

    def page(self, name: str) -> Page:
        """A page by its name, run if it has not been run yet."""
        if name not in self.pages:
            text = (self.source / f"{name}.md").read_text("utf-8")
            page = Page(self.work / "pages" / name)
            shutil.rmtree(page.folder, ignore_errors=True)
            if found := CONTINUES.search(text):
                before = self.page(found[1])
                shutil.copytree(before.folder, page.folder)
                page.namespace = dict(before.namespace)
                page.lines = None
            page.folder.mkdir(parents=True, exist_ok=True)
            if found := NEEDS.search(text):
                (page.folder / found[1]).symlink_to(self.source.parent / found[1])
                page.lines = None
            self._run(name, text, page)
            if found := PICTURES.search(text):
                take_pictures(self.source.parent / "tests" / f"{found[1]}.py", found[2], page, name)
            self.pages[name] = page
        return self.pages[name]

    def _run(self, name: str, text: str, page: Page) -> None:
        """Run all blocks of a page; a failure ends the page and is a warning, which ends a strict build."""
        began = processor_time()
        background: list[subprocess.Popen[bytes]] = []
        code = ""
        with chdir(page.folder), registries():
            try:
                for language, code in [(found[2], found[3]) for found in FENCE.finditer(text)]:
                    if language in RUN:
                        page.printed.append("")
                        self._block(name, language, code, page, background)
                finish(background)
            except (Exception, SystemExit) as problem:
                printed = page.printed[-1]
                log.warning("does not run:\n%s\n%s\n%r", code, printed, problem, location=name)
                for process in background:
                    os.killpg(process.pid, signal.SIGKILL)
        page.seconds = processor_time() - began

    def _block(
        self, name: str, language: str, code: str, page: Page, background: list[subprocess.Popen[bytes]]
    ) -> None:
        output = io.StringIO()
        try:
            with redirect_stdout(output), redirect_stderr(output):
                if language == "python":
                    page.lines = None
                    run_python(code, name, page.namespace)
                else:
                    self._commands(code, page, background)
        finally:
            page.printed[-1] = output.getvalue()

    def _commands(self, code: str, page: Page, background: list[subprocess.Popen[bytes]]) -> None:
        """Run the commands of a block; a line that ends with ``&`` in the background."""
        for line in code.replace("\\\n", " ").splitlines():
            words = shlex.split(line, comments=True)
            if not words:
                continue
            if words[-1] == "&":
                shell = self._shell(line.rpartition("&")[0])
                process = subprocess.Popen(
                    shell, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, start_new_session=True
                )
                background.append(process)
                if "serve" in words:  # it says when it listens, and ends with the page
                    print(process.stdout.readline().decode(), end="")  # type: ignore[union-attr]
            elif words[0] == "emsid" and not set(words) & {"|", "&&", "<", ";"} and "*" not in line:
                self._emsid(line, words, page)
                continue
            else:
                done = subprocess.run(self._shell(line), capture_output=True, text=True)
                print(done.stdout, done.stderr, sep="", end="")
                done.check_returncode()
            page.lines = None

    def _emsid(self, line: str, words: list[str], page: Page) -> None:
        """Run a command of emsid; an identification that another page has begun with in the same way runs once."""
        page.lines = None if page.lines is None else (*page.lines, line)
        if page.lines in self.begun:
            printed, kept = self.begun[page.lines]
            shutil.copytree(kept, page.folder, dirs_exist_ok=True)
            print(printed, end="")
            return
        target, output = words[words.index(">") + 1] if ">" in words else None, io.StringIO()
        with ExitStack() as stack:
            if target:
                stack.enter_context(redirect_stdout(stack.enter_context(open(target, "w", encoding="utf-8"))))
            else:
                stack.enter_context(redirect_stdout(output))
                stack.enter_context(redirect_stderr(output))
            status = run_emsid(words[: words.index(">")] if target else words)
        print(output.getvalue(), end="")
        if status:
            raise RuntimeError(f"exit status {status}: {line}")
        if page.lines is not None and words[1] == "identify":
            kept = self.work / "begun" / str(len(self.begun))
            shutil.rmtree(kept, ignore_errors=True)
            shutil.copytree(page.folder, kept)
            self.begun[page.lines] = output.getvalue(), kept

    def _shell(self, line: str) -> list[str]:
        """The words that run a line in Bash, where ``emsid`` and ``python`` are this program and this Python."""
        self.programs.mkdir(parents=True, exist_ok=True)
        for name, words in (("emsid", "-m emsid"), ("python", "")):
            path = self.programs / name
            path.write_text(f'#!/bin/sh\nexec "{sys.executable}" {words} "$@"\n')
            path.chmod(0o755)
        return ["bash", "-euo", "pipefail", "-c", f"PATH={shlex.quote(str(self.programs))}{os.pathsep}$PATH; {line}"]


def take_pictures(tests: Path, which: str, page: Page, name: str) -> None:
    """Run tests that leave pictures in the folder of a page; they are skipped where they have no browser.

    The site needs none of the packages of `TAKES_PICTURES`; where one is missing, the page is without its pictures.
    Where EMSID_PICTURES names a folder, they have been run and their pictures are there.
    """
    if taken := os.environ.get("EMSID_PICTURES"):
        for file in Path(taken).glob("*.png"):
            shutil.copy(file, page.folder)
        return
    if not all(map(find_spec, TAKES_PICTURES)):
        return
    began = processor_time()
    words = [sys.executable, "-m", "pytest", "-q", "-n", "0", str(tests), "-k", which]
    setting = {**os.environ, "EMSID_PICTURES": str(page.folder)}
    done = subprocess.run(words, cwd=tests.parent.parent, env=setting, capture_output=True, text=True)
    if done.returncode not in (0, 5):  # 5: there is no test, as a package is missing
        log.warning("%s fails:\n%s", tests.name, done.stdout[-2000:] + done.stderr[-2000:], location=name)
    page.seconds += processor_time() - began


@contextmanager
def registries() -> Iterator[None]:
    """Undo what a page registers, at its end."""
    from emsid.excitation import SIGNALS
    from emsid.identification.candidates import CANDIDATES
    from emsid.io import READERS
    from emsid.models.blocks.static_maps import STATIC_MAPS
    from emsid.models.plants.registry import PLANTS
    from emsid.plant.friction import FRICTION_LAWS

    tables: tuple[dict[str, Any], ...] = (READERS, SIGNALS, STATIC_MAPS, FRICTION_LAWS, PLANTS, CANDIDATES)
    before = [dict(table) for table in tables]
    try:
        yield
    finally:
        for table, entries in zip(tables, before, strict=True):
            table.clear()
            table.update(entries)


def finish(background: list[subprocess.Popen[bytes]]) -> None:
    """Wait for programs in the background, then end those that serve, as Ctrl-C does.

    Raises:
        RuntimeError: for one that fails, or does not end.
    """
    for process in sorted(background, key=serves):
        if serves(process):
            os.killpg(process.pid, signal.SIGINT)
        try:
            process.communicate(timeout=60)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            raise RuntimeError(f"{process.args!r} does not end") from None
        if process.returncode and not serves(process):
            raise RuntimeError(f"{process.args!r} ends with status {process.returncode}")


def serves(process: subprocess.Popen[bytes]) -> bool:
    """Whether a program serves until it is stopped."""
    return " serve " in process.args[-1]  # type: ignore[index]


def processor_time() -> float:
    """Seconds of processor time of this process and of the programs that it has started."""
    times = os.times()
    return times.user + times.system + times.children_user + times.children_system


def run_emsid(words: list[str]) -> int:
    """Run the command line of emsid in this process.

    Args:
        words: the command, from its name on.

    Returns:
        The exit status.
    """
    from emsid.cli import main

    with patch.object(sys, "argv", words):
        try:
            main()
        except SystemExit as end:
            return int(end.code or 0)
    return 0


def run_python(code: str, page: str, namespace: dict[str, Any]) -> None:
    """Run a block of Python; a warning is an error, and the value of a last line that is an expression is printed."""
    tree = ast.parse(code)
    last = tree.body.pop() if tree.body and isinstance(tree.body[-1], ast.Expr) else None
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        exec(compile(tree, f"{page}.md", "exec"), namespace)
        if last is not None:
            value = eval(compile(ast.Expression(last.value), f"{page}.md", "eval"), namespace)
            if value is not None:
                print(repr(value))


class ShowOutput(SphinxTransform):
    """Insert the output below each block, and use the pictures that the page has written."""

    default_priority = 10

    def apply(self, **_: Any) -> None:
        """Change the tree of this page."""
        name = self.env.docname
        if self.env.doc2path(name).suffix != ".md":
            return
        blocks = [
            node
            for node in self.document.findall(nodes.literal_block)
            if (node.get("language") or "none") not in SHOWN and "output" not in node["classes"]
        ]
        for node in blocks:
            if node["language"] not in RUN:
                log.warning("fences are of %s or %s: %s", RUN, SHOWN, node["language"], location=node)
        blocks = [node for node in blocks if node["language"] in RUN]
        text = self.env.doc2path(name).read_text("utf-8")
        if not (blocks or CONTINUES.search(text) or PICTURES.search(text)):
            return
        runner: Runner = self.app.runner  # type: ignore[attr-defined]
        page = runner.page(name)
        for node, printed in zip(blocks, page.printed, strict=False):
            if printed.strip():
                node.parent.insert(node.parent.index(node) + 1, shown(printed))
        for image in list(self.document.findall(nodes.image)):
            file = page.folder / image["uri"]
            if file.is_file():
                image["uri"] = os.path.relpath(file, Path(self.env.doc2path(name)).parent)
            elif PICTURES.search(text):  # there is no browser here
                image.parent.remove(image)


class Live(SphinxDirective):
    """A page that the commands have written, in a frame and by a link; its content says what it shows."""

    required_arguments = 1
    has_content = True

    def run(self) -> list[nodes.Node]:
        """The frame, and a link to the page alone."""
        name, runner = self.env.docname, self.env.app.runner  # type: ignore[attr-defined]
        file = f"{name.replace('/', '-')}-{self.arguments[0].replace('/', '-')}"
        folder = Path(self.env.app.outdir) / "_static" / "live"
        folder.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(runner.page(name).folder / self.arguments[0], folder / file)
        address = f"{'../' * name.count('/')}_static/live/{file}"
        title = escape(" ".join(self.content))
        frame = f'<iframe class="live" src="{address}" title="{title}" loading="lazy"></iframe>'
        link = f'<p><a href="{address}">{title}</a></p>'
        return [nodes.raw("", frame + link, format="html")]


def shown(printed: str) -> nodes.container:
    """Output as nodes: lines of text wrap on a narrow page, lines of tables do not."""
    lines = [line.rstrip() for line in printed.strip("\n").splitlines()]
    left_out = len(lines) - LONGEST
    box = nodes.container(classes=["output"])
    kinds = [("  " in line.strip() or line.startswith("  "), line) for line in lines[:LONGEST]]
    while kinds:
        table = kinds[0][0]
        size = next((k for k, (each, _) in enumerate(kinds) if each != table), len(kinds))
        text = "\n".join(line for _, line in kinds[:size])
        box += nodes.literal_block(text, text, language="none", classes=["output", "aligned" if table else "wrapped"])
        kinds = kinds[size:]
    if left_out > 0:
        box += nodes.paragraph(text=f"… and {left_out} more lines")
    return box


def begin(app: Sphinx) -> None:
    """One runner for a build."""
    app.runner = Runner(Path(app.srcdir), Path(app.outdir).parent / "run")  # type: ignore[attr-defined]


def report(app: Sphinx, problem: Exception | None) -> None:
    """Print the processor time of every page."""
    pages: dict[str, Page] = app.runner.pages  # type: ignore[attr-defined]
    for name, page in sorted(pages.items(), key=lambda each: -each[1].seconds):
        print(f"{page.seconds:6.1f} s of processor time: {name}")
    print(f"{sum(each.seconds for each in pages.values()):6.1f} s of processor time for {len(pages)} pages")


def setup(app: Sphinx) -> dict[str, bool]:
    """Register with Sphinx."""
    app.connect("builder-inited", begin)
    app.connect("build-finished", report)
    app.add_transform(ShowOutput)
    app.add_directive("live", Live)
    return {"parallel_read_safe": False}
