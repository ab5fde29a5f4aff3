"""Honest comparison of surrogates: protocols, scores, significance, numbered checks.

:func:`kiribench.validation.run.cross_validate` does it all on a
:class:`kiribench.validation.table.CvTable`; ``kiribench cv`` is its command line::

    from kiribench.schema.design_space import read_design_space
    from kiribench.validation.run import cross_validate
    from kiribench.validation.settings import CvSettings
    from kiribench.validation.table import of_design_space
    result = cross_validate(of_design_space(read_design_space(path)), CvSettings())

Importing this package loads neither torch nor scikit-learn.
"""
