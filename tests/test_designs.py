"""Two hundred valid designs: of all laws, r = 1 to 4, in state and in output feedback."""

from designs import BASES, doubtful


def test_valid_designs_raise_no_doubt():
    """Gains 1.05 to 3 times what the theorem asks for, xi at 20 to 95 % of its bound."""
    assert {r for _, r, *_ in BASES} == {1, 2, 3, 4}
    assert doubtful(200) == []
