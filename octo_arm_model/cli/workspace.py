"""``octo-arm workspace``: sample the positions that the tip can reach."""

import argparse
import json
from pathlib import Path

from octo_arm_model.analysis.workspace import Workspace, draw_workspace, sample_workspace
from octo_arm_model.arm.stiffness import default_highest
from octo_arm_model.cli import arguments
from octo_arm_model.cli.files import Bar, check_out, writing

SUMMARY = 'draw the positions that the tip can reach'
DESCRIPTION = """\
Sample the workspace of the tip: solve the arm for many sets of tensions, spread evenly between 0
and --highest over all tendons, and draw the tips. Sets of tensions without a solution are counted
and left out. The arm reaches somewhat further than the tips drawn, because few of the sets have
all tendons near an end of their range.
"""
EPILOG = """\
examples:
  octo-arm workspace renda2012_table4 --out cloud.png
  octo-arm workspace renda2012_prototype --highest 3 --samples 16384
  octo-arm workspace renda2012_table2 --highest '[[1,1,1,1],[0,0,0,0],[0,0,0,0]]' --json
  octo-arm workspace renda2012_table4 --samples 256 --model exact \\
      --gravity 0 0 -9.81 --density 1080

A set of tensions takes a fraction of a millisecond, but with gravity, water or other loads ten
to a hundred milliseconds: start with few --samples then. The same --seed, --samples and --highest
give the same tips with any --processes or --scheduler. The exit status is 1 if no set has a shape.
"""
_COMPRESSION = 0.1  # largest compression by one tendon of the section at its anchorage


_HIGHEST = """\
for each tendon the least tension that alone compresses the section at its anchorage by 10 percent,
    bends the arm by two turns, or is 10 percent of that which folds it"""
OPTIONS = f"""\
{arguments.ARM}
{arguments.highest_option(_HIGHEST)}
--samples N = 4096: number of sets of tensions, at best a power of two
--seed N = 0: seed of the sets of tensions
--processes N int: number of worker processes; by default one for each core if that is faster
--scheduler ADDRESS: Dask scheduler whose workers solve instead, such as tcp://10.0.0.1:8786; needs
    pip install 'octo_arm_model[cluster]'
--out PNG path: picture to write (default: workspace.png; with --json none)
{arguments.JSON}: highest, seed, refused, and of each set with an answer its tensions, tip and
    direction
"""


def run(options: argparse.Namespace) -> int:
    """Solve all samples, and draw and print the positions of the tip; return 1 if none is."""
    config = arguments.read_config(options)
    usual = None if options.json else Path('workspace.png')
    out = check_out(options, '--out', folder=False, draws=True, usual=usual)
    highest = arguments.read_highest(options)
    with Bar('sets of tensions') as bar:
        workspace = sample_workspace(
            config,
            default_highest(config.arm, _COMPRESSION) if highest is None else highest,
            options.samples,
            options.seed,
            processes=options.processes,
            scheduler=options.scheduler,
            progress=bar,
        )
    if out is not None:
        with writing(out) as place:
            draw_workspace(workspace, config.solver(), place)
    print(
        json.dumps(as_dict(workspace, config.model, options.seed))
        if options.json
        else summary(workspace, config.model, out)
    )
    return int(not len(workspace.tip))


def as_dict(workspace: Workspace, model: str, seed: int) -> dict[str, object]:
    """Return the workspace as plain lists in SI units, for JSON."""
    arrays = ('highest', 'tensions', 'tip', 'direction')
    return {
        'model': model,
        'seed': seed,
        'samples': len(workspace.tip) + workspace.refused,
        'refused': workspace.refused,
        **{name: getattr(workspace, name).tolist() for name in arrays},
    }


def summary(workspace: Workspace, model: str, picture: Path | None) -> str:
    """Return the number and the extent of the tips as text, in millimetres."""
    reached, refused = len(workspace.tip), workspace.refused
    low, high = (f'{one:.4g}' for one in (workspace.highest.min(), workspace.highest.max()))
    lines = [
        f'model     {model}',
        f'tensions  up to {low if low == high else f"{low} ... {high}"} N',
        f'tips      {reached} of {reached + refused} sets of tensions, {refused} refused',
    ]
    if not reached:
        lines.append('          none: give a lower --highest, or see what solve says of one set')
    else:
        for name, reach in zip('xyz', 1e3 * workspace.tip.T):
            least, most = reach.min(), reach.max()
            lines.append(
                f'{name}         {least:.2f} to {most:.2f} mm, {most - least:.2f} mm in all'
            )
    if picture is not None:
        lines.append(f'picture   {picture}')
    return '\n'.join(lines)
