"""The folder of the checkout, and the preset arms in it."""

from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
PAPERS_PRESETS = ('renda2012_fem', 'renda2012_prototype', 'renda2012_table2', 'renda2012_table4')
PRESETS = (*PAPERS_PRESETS, 'rao2021')
