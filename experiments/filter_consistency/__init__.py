"""Whether the filter tells the truth about itself, on simulated flights with nothing missing.

    python -m sinan.experiments.filter_consistency errors      NEES of every scenario and block
    python -m sinan.experiments.filter_consistency flights     NIS of every sensor, p-values of every candidate effect
    python -m sinan.experiments.filter_consistency heading     where linearisation breaks, and the cure: first headings
    python -m sinan.experiments.filter_consistency hover       the same for first attitudes of a hover

Results: docs/notes/filter_consistency.md.
"""
