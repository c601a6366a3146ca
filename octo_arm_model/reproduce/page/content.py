"""The blocks of the page, in the order of the paper. Needs matplotlib."""

from __future__ import annotations

from collections.abc import Sequence

from octo_arm_model import __version__
from octo_arm_model.config.paper_data import (
    FETCHING_IN_PLANE,
    FETCHING_IN_SPACE,
    PROTOTYPE_AVERAGE_ERROR,
    PROTOTYPE_ERRORS,
)
from octo_arm_model.reproduce import cases, figures, tables
from octo_arm_model.reproduce.claims.claim import Claim, count
from octo_arm_model.reproduce.page.html_page import TITLE, Block, Picture, heading, paragraph
from octo_arm_model.rod.solver import MODELS

_MADE = f"""\
Every number and curve here was computed when the page was made, by octo-arm reproduce of \
octo_arm_model {__version__}, from the parameters and tensions that the paper prints. Sections, \
figures and tables have the paper’s numbers, and its axes: the base at the origin with \
t = (1, 0, 0), n = (0, −1, 0), b = (0, 0, −1)."""
_MODELS = """\
Three models answer. renda2012 is the paper’s: its equations (10), its jump (11) at each \
anchorage, integrated from the tip (12). closed_form is the paper’s moments (8a) and material \
(3a), solved at each cross section without the jump; where one section alone is loaded the two \
are the same, and their lines lie on each other. exact does not take s for the arc length of \
midline and cables, and its material is incompressible rubber (neo-Hookean) instead of linear."""
_READ = """\
The paper’s pictures are to be compared by eye: nothing was read off them. What its text, tables \
and captions say in words and numbers is checked below."""
_MISSING = (
    'Figure 8: the tensions, the output of the finite elements, and E and ν of the arm.',
    'Figure 9 and Table 1: the midlines taken from the camera’s pictures, and ν. The text says '
    '3 N of Figure 9; Table 1 lists 3.06 N and no 3 N. Both are drawn.',
    'Figure 10: the arm and the tensions; here those of Table 2 and 1 N, in the ratios of the '
    'law.',
    'Section 4: the density of the silicone, and so how well weight and buoyancy cancel.',
    'Sections 1 and 7: how fast is fast enough.',
)


def summary(claims: Sequence[Claim]) -> str:
    """A sentence with the number of claims that hold, for each model."""
    counts = [(model, *count(claims, model)) for model in MODELS]
    return (
        'Claims that hold, of those that can be judged: '
        + ', '.join(f'{model} {held} of {judged}' for model, held, judged in counts)
        + '.'
    )


def blocks(claims: Sequence[Claim]) -> list[Block]:
    """Everything on the page, in the order of the paper."""
    return [
        heading(TITLE, 1),
        paragraph(
            'F. Renda, M. Cianchetti, M. Giorelli, A. Arienti, C. Laschi: A 3D steady-state model '
            'of a tendon-driven continuum soft manipulator inspired by the octopus arm. '
            'Bioinspir. Biomim. 7 (2012) 025006.'
        ),
        *(paragraph(text) for text in (_MADE, _MODELS, _READ)),
        heading('What the text claims'),
        paragraph(f'The paper’s words, shortened. {summary(claims)}'),
        *claims,
        heading('The arms'),
        tables.arms(),
        heading('5.1 Analytical versus FEM model'),
        Picture(
            'Figure 8',
            'Arm of section 5.1, one cable; the body is true to scale. The paper shows finite '
            'elements above its model, but neither their output nor a tension: those above the '
            'panels are ours.',
            2.9,
            figures.figure_8,
        ),
        tables.finite_elements(),
        heading('5.2 Analytical model versus real prototype'),
        Picture(
            'Figure 9',
            'Left, the prototype at 3 N; the midline of the real arm, which the paper compares '
            'it with, was not published. Right, at each tension of Table 1.',
            2.75,
            figures.figure_9,
        ),
        tables.tip_errors(),
        heading('6.1 Bending'),
        Picture(
            'Figure 10',
            'Bending planes and the ratios of the cables’ tensions, seen from the tip: the arm of '
            'Table 2, amplitude 1 N, section 1.',
            4.75,
            figures.figure_10,
        ),
        tables.tensions(),
        Picture(
            'Figure 11',
            'Three planes of bending, tensions of Table 3: in space, and seen from the tip.',
            4.4,
            figures.figure_11,
        ),
        tables.bending(),
        Picture(
            'Figure 12',
            'Degrees of freedom along the arm of Figure 11(A). By all models the torsion is 0.',
            3.3,
            figures.figure_12,
        ),
        heading('6.2 Fetching'),
        Picture(
            'Figure 14',
            'Fetching in one plane: the arm of Table 4, tensions of Table 5; the body is true to '
            'scale.',
            4.6,
            figures.figure_14,
        ),
        tables.fetching(),
        Picture(
            'Figure 15',
            'Views of fetching in three dimensions: the arm of Table 4, tensions of Table 5.',
            5.3,
            figures.figure_15,
        ),
        heading('What the paper does not give'),
        *(paragraph(text) for text in _MISSING),
        heading('Where the paper is at odds with itself'),
        *(paragraph(text) for text in _contradictions()),
    ]


def _contradictions() -> tuple[str, ...]:
    mean = sum(PROTOTYPE_ERRORS.values()) / len(PROTOTYPE_ERRORS)
    most = -100.0 * min(
        float(cases.solve('table4', 'renda2012', tensions).q.min())
        for tensions in (FETCHING_IN_PLANE, FETCHING_IN_SPACE)
    )
    return (
        'Section 5.1 says that all material and geometric properties of the real prototype have '
        'been used; the arm that it describes is not that of section 5.2.',
        f'Table 1 prints an average of {PROTOTYPE_AVERAGE_ERROR} %; the mean of its rows is '
        f'{mean:.2f} %.',
        'Section 6.1 says that Figure 12 is of ‘the 45° bending’; its caption says that it is of '
        'Figure 11(A), which is at 135° by its caption and Table 3. The arctangent printed there '
        'gives −45° for it: it cannot tell opposite sides apart, as the two differences with '
        'their signs can.',
        'The jump (11) adds the curvature that a section’s own cables would make alone; the '
        'moments (8a) ask for one balance of all cables. Where several sections are loaded the '
        'two differ, as renda2012 and closed_form do in Figures 14 and 15, and the jump makes '
        'the only torsion there is.',
        'Section 4 takes s for the arc length. The fetching tensions of Table 5 shorten the arm '
        f'by up to {most:.0f} % in places, which is where exact leaves the other two.',
    )
