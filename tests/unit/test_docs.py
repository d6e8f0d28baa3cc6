"""The documentation: commands that exist, a reference that is the program's own, a whole site."""

from __future__ import annotations

import contextlib
import importlib.util
import re
import shutil
import subprocess
import sys
from pathlib import Path

import click
import pytest
from lxml import html

from automap.effects.catalogue import CATALOGUE
from automap.export.fields import SIGN_FIELDS
from pipeline.cli.root import cli
from pipeline.run.registry import load_stages
from pipeline.settings.load import load_settings
from pipeline.shared.values import flatten
from tests.docs_commands import DOCS, ROOT, Command, commands, pages

ALL = [command for page in pages() for command in commands(page)]


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The built site."""
    folder = tmp_path_factory.mktemp("site")
    done = subprocess.run(
        [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "--site-dir", str(folder)],
        cwd=ROOT,
        env={
            "PATH": "/usr/bin:/bin",
            "NO_MKDOCS_2_WARNING": "1",
            "http_proxy": "http://127.0.0.1:9",
        },
        capture_output=True,
        text=True,
        check=False,
    )
    # strict: a link to nowhere is a failure
    assert done.returncode == 0, done.stdout + done.stderr
    return folder


def text_of(site: Path, page: str) -> str:
    content = html.parse(str(site / page)).getroot().xpath("//article")[0]
    return " ".join(str(content.text_content()).split())


def test_every_file_that_the_outputs_name_is_written_by_a_stage() -> None:
    page = (DOCS / "outputs.md").read_text(encoding="utf-8").split("## Columns")[0]
    listed = set()
    for first in re.findall(r"^\| (`[^|]+) \|", page, re.MULTILINE):
        listed |= set(re.findall(r"`([\w./]+)`", first))
    written = {name for stage in load_stages() for name in stage.outputs}
    assert len(listed) > 10
    assert listed - written == {"run.json", "automap.log"}


@pytest.mark.parametrize("command", ALL, ids=lambda c: f"{c.page}: {c.line[:60]}")
def test_every_command_is_one_of_ours_and_its_options_too(command: Command) -> None:
    words = command.words
    if words[:2] == ["python", "-m"]:
        assert importlib.util.find_spec(words[2]) is not None
    elif words[0] == "automap":
        # --help ends the parsing, well
        with contextlib.suppress(click.exceptions.Exit):
            parse(cli, "automap", words[1:])
    else:
        assert words[0] in ("pip", "make", "ssh"), f"nothing checks {command.line}"


def parse(command: click.Command, name: str, words: list[str]) -> None:
    """Parse words as the command line does, down to the last subcommand."""
    context = command.make_context(name, list(words))
    if isinstance(command, click.Group):
        rest = [*context._protected_args, *context.args]
        below, inner, left = command.resolve_command(context, rest)
        assert inner is not None
        parse(inner, str(below), left)


def test_a_wrong_option_would_be_noticed() -> None:
    with pytest.raises(click.UsageError):
        parse(cli, "automap", ["run", "drive", "--no-such-option"])
    with pytest.raises(click.UsageError):
        parse(cli, "automap", ["no-such-command"])


def test_the_pages_name_enough_commands() -> None:
    named = {command.words[1] for command in ALL}
    assert {"run", "check", "view", "export", "evaluate", "calibrate", "detect", "gap"} <= named
    assert sum(command.runnable for command in ALL) >= 20


def test_the_reference_has_every_effect_setting_field_and_command(site: Path) -> None:
    effects = text_of(site, "reference/effects.html")
    for effect in CATALOGUE.values():
        assert effect.name in effects
        assert effect.summary in effects
    settings = text_of(site, "reference/configuration.html")
    echo = load_settings().echo()
    for section in echo:
        assert section in settings
    for key in flatten(echo):
        # a table's own keys are the user's
        assert key.split(".")[1] in settings, key
    fields = text_of(site, "reference/sign-fields.html")
    for field in SIGN_FIELDS:
        assert field.meaning in fields
    reference = text_of(site, "reference/commands.html")
    for name in cli.list_commands(click.Context(cli)):
        assert f"automap {name}" in reference


@pytest.mark.slow
def test_the_man_page_has_every_command_and_is_roff(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, str(DOCS / "site" / "manual.py"), str(tmp_path)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    page = tmp_path / "automap.1"
    text = page.read_text(encoding="utf-8")
    for name in cli.list_commands(click.Context(cli)):
        assert f'.SH "automap {name}"' in text
    assert r".B \-o, \-\-out" in text
    macros = {line.split(" ")[0] for line in text.splitlines() if line.startswith(".")}
    assert macros <= {".TH", ".SH", ".SS", ".B", ".TP", ".PP", ".nf", ".fi"}
    if shutil.which("groff") is not None:
        checked = subprocess.run(
            ["groff", "-man", "-Tutf8", "-ww", "-z", str(page)],
            capture_output=True,
            text=True,
            check=False,
        )
        assert checked.stderr == ""


def test_the_site_asks_no_other_host_for_anything(site: Path) -> None:
    for page in site.rglob("*.html"):
        tree = html.parse(str(page)).getroot()
        loaded = tree.xpath(
            "//script/@src | //img/@src | //iframe/@src | //link[@rel='stylesheet']/@href"
            " | //link[@rel='preconnect']/@href | //link[@rel='icon']/@href"
        )
        assert [url for url in loaded if re.match(r"(https?:)?//", str(url))] == [], page.name
        for style in tree.xpath("//style/text()"):
            assert "http" not in str(style)


def test_equations_are_drawn_without_a_script(site: Path) -> None:
    for page in sorted((DOCS / "theory").glob("*.md")):
        source = page.read_text(encoding="utf-8")
        built = (site / "theory" / f"{page.stem}.html").read_text(encoding="utf-8")
        assert built.count('display="block"') == source.count("$$") // 2
        assert built.count('display="inline"') == len(re.findall(r"\\\(", source))
        assert "arithmatex" not in built


def test_every_page_is_listed(site: Path) -> None:
    start = html.parse(str(site / "index.html")).getroot()
    listed = {str(link) for link in start.xpath("//nav//a/@href")}
    for page in pages():
        name = page.relative_to(DOCS).with_suffix(".html").as_posix()
        assert name in listed or name == "index.html", name
