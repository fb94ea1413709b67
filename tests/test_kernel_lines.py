"""What ``make coverage`` tells of compiled functions."""

from kernel_lines import compiled_lines, ranges

SOURCE = '''
def plain():
    return 0

@ti.func
def one(x):
    """Text."""
    if ti.static(x):
        y = 1
    return (
        y
    )

@law_with_derivative(lambda x, y: x)
def two(x):
    return x
'''


def test_statements_of_compiled_functions_alone_count_and_texts_do_not():
    assert sorted(compiled_lines(SOURCE)) == [8, 9, 10, 16]


def test_lines_that_follow_one_another_are_told_together():
    assert ranges([3, 5, 6, 7, 9]) == "3, 5-7, 9"
