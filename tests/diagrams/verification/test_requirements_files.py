"""The project's own requirements files: pytest judges them in the slow suite, here they only have to fit."""

import pytest

from quietfix.diagrams.assembly.find import systems
from quietfix.diagrams.verification.verify import Verification


@pytest.mark.parametrize("system", systems())
def test_every_system_has_one_that_fits(project_root, system):
    verification = Verification(project_root / "tests" / "requirements" / f"{system}.requirements.yaml")
    verification.build()
    assert verification.specification.system == system and verification.specification.slow
    for requirement in verification.specification.requirements:
        assert len(requirement.why) > 5, f"{requirement.name}: where does the limit come from?"


def test_there_are_no_others(project_root):
    names = {path.name for path in (project_root / "tests" / "requirements").iterdir()}
    assert names == {f"{system}.requirements.yaml" for system in systems()}
