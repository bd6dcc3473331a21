"""The commands with their arguments and help, for typer."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from typing import Annotated, Any

import typer
from typer.core import TyperCommand, TyperOption

from ambkit.cli import from_verbs
from ambkit.cli.campaign import (
    RUN,
    OfCampaigns,
    campaign,
    campaign_problem,
    campaign_rare,
    campaign_replay,
    campaign_report,
    campaign_run,
    campaign_status,
)
from ambkit.cli.check import check
from ambkit.cli.compare import compare
from ambkit.cli.export import export, export_c
from ambkit.cli.export_a2l import export_a2l
from ambkit.cli.export_fmu import export_fmu, export_ssp
from ambkit.cli.export_mat import export_mat
from ambkit.cli.filter import filter_record
from ambkit.cli.identify import identify
from ambkit.cli.parameters import keep_inputs
from ambkit.cli.presets import presets
from ambkit.cli.read import read
from ambkit.cli.reproduce import reproduce
from ambkit.cli.simulate import simulate
from ambkit.cli.train import train

# Plain help: typer's help in colour takes longer to import than all else here together.
app = typer.Typer(
    name="ambkit",
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    add_completion=False,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
)
_COMMANDS: dict[str, Callable[..., None]] = {
    "reproduce": reproduce,
    "simulate": simulate,
    "excite": from_verbs.command("excite"),
    "read": read,
    "identify": identify,
    "train": train,
    "tune": from_verbs.command("tune"),
    "filter": filter_record,
    "compare": compare,
    "design": from_verbs.command("design"),
    "assess": from_verbs.command("assess"),
    "faults": from_verbs.command("faults"),
    "rotor": from_verbs.command("rotor"),
    "pil": from_verbs.command("pil"),
    "presets": presets,
    "check": check,
}
_EXPORTS: dict[str, Callable[..., None]] = {
    "c": export_c,
    "fmu": export_fmu,
    "mat": export_mat,
    "ssp": export_ssp,
    "a2l": export_a2l,
}
_CAMPAIGN: dict[str, Callable[..., None]] = {
    RUN: campaign_run,
    "status": campaign_status,
    "report": campaign_report,
    "replay": campaign_replay,
    "rare": campaign_rare,
    "problem": campaign_problem,
}


class Command(TyperCommand):
    """A command that does not begin where it would overwrite what it reads, or drop an option."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Refuse an option that is given twice and taken once: the first would be dropped."""
        for option in self.params:
            if not isinstance(option, TyperOption) or option.multiple or option.is_flag:
                continue
            if sum(argument.partition("=")[0] in option.opts for argument in args) > 1:
                raise typer.BadParameter("is given more than once", ctx, option)
        return super().parse_args(ctx, args)

    def invoke(self, ctx: Any) -> Any:
        """Run it."""
        keep_inputs(ctx)
        return super().invoke(ctx)


def _help(command: Callable[..., None]) -> str:
    r"""Return a docstring as click's help; "\b" keeps it from filling an example's lines."""
    paragraphs = inspect.cleandoc(command.__doc__ or "").split("\n\n")
    return "\n\n".join(f"\b\n{text}" if "\n  " in text else text for text in paragraphs)


for _name, _command in _COMMANDS.items():
    app.command(_name, cls=Command, help=_help(_command))(_command)


def _print_version(flag: bool) -> None:
    if flag:
        import ambkit

        print(f"ambkit {ambkit.__version__}")
        raise typer.Exit


def about(
    context: typer.Context,
    version: Annotated[
        bool,
        typer.Option(
            "--version", callback=_print_version, is_eager=True, help="Print the version."
        ),
    ] = False,
    _debug: Annotated[
        bool,
        typer.Option("--debug", help="With an error, show where in the program it came from."),
    ] = False,
) -> None:
    """From a magnetic bearing's description, or a recording, to a tuned adaptive Kalman filter.

    To begin with:
      ambkit reproduce                         the paper, with pictures and verdicts
      ambkit presets zittau_axial > my.toml    a bearing, to be edited
      ambkit simulate my.toml --step "0.3 mm" --out run.csv
      ambkit filter run.csv --bearing my.toml --plot run.png
    """
    if context.invoked_subcommand is None:
        print(context.get_help())


_export = typer.Typer(name="export", callback=export, invoke_without_command=True)
for _name, _command in _EXPORTS.items():
    _export.command(_name, cls=Command, help=_help(_command))(_command)
app.add_typer(_export, help=_help(export))
_campaign = typer.Typer(
    name="campaign", cls=OfCampaigns, callback=campaign, invoke_without_command=True
)
for _name, _command in _CAMPAIGN.items():
    _campaign.command(_name, cls=Command, help=_help(_command))(_command)
app.add_typer(_campaign, help=_help(campaign))
app.callback(help=_help(about), invoke_without_command=True)(about)
