"""Run searches side by side: the loop that all studies and benchmarks use."""

from collections.abc import Callable, Hashable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Protocol, TypeVar

from optim.experiments.results import Progress
from optim.problem import Evaluation, Request
from optim.runs.requests import join_requests, part_of
from optim.search.method import Method, next_request
from taichi_sim.base.arrays import Floats


class Search(Protocol):
    """A search that takes turns beside others."""

    @property
    def turns(self) -> int:
        """Number of completed turns, including those before an interruption."""

    @property
    def done(self) -> bool:
        """Whether the search takes no further turn."""

    def ask(self) -> Request:
        """Points that the search wants evaluated next; asking changes nothing."""

    def tell(self, request: Request, evaluation: Evaluation) -> None:
        """Receive the evaluation of the points that it asked for."""


AnySearch = TypeVar("AnySearch", bound=Search)
EvaluateRound = Callable[[Sequence[AnySearch], Sequence[Request]], Iterable[Evaluation]]


def run_side_by_side(
    searches: Iterable[AnySearch], evaluate: EvaluateRound[AnySearch], after_round: Callable[[], object] | None = None
) -> None:
    """Let searches take turns until all are done; those with the fewest completed turns move first.

    ``evaluate`` gives the evaluations of a round's requests, in their order. A search is told each evaluation before
    the next one is asked for: a generator loses at most the evaluation at hand when it is interrupted.
    """
    active = [search for search in searches if not search.done]
    while active:
        fewest = min(search.turns for search in active)
        behind = [search for search in active if search.turns == fewest]
        requests = [search.ask() for search in behind]
        for search, request, evaluation in zip(behind, requests, evaluate(behind, requests), strict=True):
            search.tell(request, evaluation)
        if after_round:
            after_round()
        active = [search for search in active if not search.done]


def evaluate_together(
    searches: Sequence[AnySearch],
    requests: Sequence[Request],
    evaluate: Callable[[Sequence[AnySearch], Request], Evaluation],
    kind: Callable[[AnySearch], Hashable] = lambda search: None,
) -> Iterator[Evaluation]:
    """Evaluate the requests of several searches in as few batches as possible; yield their evaluations in order.

    ``evaluate`` is called with the search of each point, and the points of one batch; a point's evaluation must not
    depend on those beside it. One batch takes requests of searches of an equal ``kind`` that want the same.
    """
    batches: dict[Hashable, list[int]] = {}
    for number, (search, request) in enumerate(zip(searches, requests, strict=True)):
        batches.setdefault((kind(search), request.wants, request.sharpness, request.minibatch), []).append(number)
    found: dict[int, Evaluation] = {}
    for numbers in batches.values():
        owners = [searches[number] for number in numbers for _ in requests[number].points]
        evaluation, first = evaluate(owners, join_requests([requests[number] for number in numbers])), 0
        for number in numbers:
            end = first + len(requests[number].points)
            found[number], first = part_of(evaluation, slice(first, end)), end
    for number in range(len(requests)):
        yield found[number]


@dataclass(eq=False)
class BudgetedSearch:
    """A search in memory that ends when its budget of evaluations is spent, or when its observer says so."""

    name: int  # its name for the observer, such as a number
    method: Method  # the method, not yet used
    budget: float  # evaluations of the search; those of its last turn beyond the budget are not observed
    observe: Callable[[int, Floats, Evaluation], bool]  # called with the name and what is new; returns whether to end
    turns: int = 0  # number of turns so far
    spent: float = 0  # evaluations so far, those of the last turn beyond the budget included
    done: bool = False  # whether the budget is spent, or the observer has ended the search
    price: float = 1.0  # of an evaluation with its gradient, in those without

    def ask(self) -> Request:
        """Points that the method wants evaluated next."""
        return next_request(self.method)

    def tell(self, request: Request, evaluation: Evaluation) -> None:
        """Tell the method, then the observer."""
        price = self.price if request.wants == "gradients" else 1
        left = slice(0, int((self.budget - self.spent) // price))
        self.method.tell(request.points, evaluation)
        self.turns, self.spent = self.turns + 1, self.spent + price * len(request.points)
        ended = self.observe(self.name, request.points[left], part_of(evaluation, left))
        self.done = ended or self.spent >= self.budget


def run_with_budget(
    methods: Iterable[Method],
    budget: float,
    evaluate: Callable[[Sequence[BudgetedSearch], Request], Evaluation],
    observe: Callable[[int, Floats, Evaluation], bool],
    progress: Progress = None,
    price: float = 1.0,
) -> None:
    """Run searches in memory side by side, see :class:`BudgetedSearch`, and evaluate their points together."""
    searches = [BudgetedSearch(number, method, budget, observe, price=price) for number, method in enumerate(methods)]

    def after_round() -> None:
        if progress:
            progress(sum(search.done for search in searches) / len(searches))

    run_side_by_side(searches, partial(evaluate_together, evaluate=evaluate), after_round)
