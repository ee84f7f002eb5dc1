"""An adversary: problems whose answers are known are spoilt in one way each, and solved.

The law. Of a spoilt problem one of these holds:

* it is refused with a `PyRobocopError`, where it is stated or where it is solved;
* its result is not ``solved``;
* it has an answer, and that is right;
* the first lines of its result name a doubt: ``result.doubts``, NOT SAFE, or COARSE MESH where that is not said of the
  unspoilt problem as well.

What is right depends on what the spoiling means (`spoilers.Law`):

``SAME``
    The problem is written in another way, or started from elsewhere. The answer is that of the unspoilt problem,
    converted to its units. Where the problem is not convex, another local optimum by the independent judge is right as
    well.
``STATED``
    Another problem that makes sense by itself: a dropped row, indices that were swapped, a cost of the other sign.
    Nobody can know from it what was meant. The answer has to solve what is stated, by the independent judge.
``DOUBTED``
    What is stated has no solution, or shows by its structure that it cannot be meant: two phases that nothing joins,
    values of another model, a start where the stated limits do not hold, equations that were never discretised, data
    that are no numbers. No answer is right.

A start that was forgotten is ``STATED``: a free start is what many problems ask for, and a state that rows and
objective determine leaves nothing in doubt. Where a variable is left that nothing determines, the package may say so;
the judge does not ask for it, since the values of such a variable change neither a row nor the objective.

The judge (`judge.Judge`) uses neither residuals nor scales nor sessions of the package. In the user's units it
evaluates every active row, bound and pair by ``pyo.value``, each measured by the size of its terms. Then it gives the
same rows, with the pairs replaced by the branch that the answer is on, to the executable of Ipopt through Pyomo: from
the answer and from a point beside it, within a twentieth of the size of each variable. A point there that meets all
rows as well, and is better by more than a ten-thousandth of the objective's size, shows that the answer is no optimum.
"""
