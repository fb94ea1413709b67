"""Bodies that evolve for learning: resistance to interference beside speed, and evolution and learning in two loops."""

from optim.studies.beyond.evolving_bodies.study import STUDY as STUDY
