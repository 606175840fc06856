"""A pytest plugin: every requirement in a ``*.requirements.yaml`` file is a test.

The items of one file share its studies, which run when the first of them is reached; JUnit XML and selection are
pytest's own. Items carry the marker ``slow`` unless the file says ``slow: false``, and ``xdist_group`` (file and case)
where pytest-xdist is there: with ``--dist loadgroup`` one worker runs a case. With other ways of distributing, workers
that share the items of a case each run its study; the verdicts are the same.

Loaded in every pytest session where Quietfix is installed; nothing else is imported until such a file is collected.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from quietfix.diagrams.verification.specification import Requirement
    from quietfix.diagrams.verification.verify import Verification

__all__ = ["RequirementItem", "RequirementsFile"]

_SUFFIX = ".requirements.yaml"


class RequirementError(Exception):
    """A requirement fails or is undecided; the message is one line."""


def pytest_configure(config: pytest.Config) -> None:
    """Register the markers that items carry."""
    config.addinivalue_line("markers", "slow: takes more than a few seconds")
    if not config.pluginmanager.hasplugin("xdist"):
        config.addinivalue_line("markers", "xdist_group(name): tests that one worker runs")


def pytest_collect_file(file_path: Path, parent: pytest.Collector) -> RequirementsFile | None:
    """Collect requirements files."""
    if not file_path.name.endswith(_SUFFIX):
        return None
    return RequirementsFile.from_parent(parent, path=file_path)


class RequirementsFile(pytest.File):
    """A requirements file."""

    def collect(self) -> Iterator[RequirementItem]:
        """Yield one item per requirement."""
        from quietfix.diagrams.schema.errors import UserError
        from quietfix.diagrams.verification.verify import Verification

        try:
            verification = Verification(self.path)
        except UserError as error:
            raise self.CollectError(str(error)) from None
        for requirement in verification.specification.requirements:
            name = requirement.name if not requirement.case else f"{requirement.name} [{requirement.case}]"
            item = RequirementItem.from_parent(self, name=name, requirement=requirement, verification=verification)
            if verification.specification.slow:
                item.add_marker("slow")
            item.add_marker(pytest.mark.xdist_group(f"{self.nodeid}:{requirement.case}"))
            yield item


class RequirementItem(pytest.Item):
    """One requirement."""

    def __init__(self, *, requirement: Requirement, verification: Verification, **keywords: Any) -> None:
        super().__init__(**keywords)
        self.requirement, self.verification = requirement, verification

    def runtest(self) -> None:
        """Judge it; what is not held is a failure, also what is undecided."""
        from quietfix.diagrams.schema.errors import UserError
        from quietfix.diagrams.statistics.sequential import HOLDS

        try:
            finding = self.verification.judge(self.requirement)
        except UserError as error:
            raise RequirementError(str(error)) from None
        for key, value in finding.as_json().items():
            if key in ("estimate", "lower", "upper", "trials", "verdict"):
                self.user_properties.append((key, value))
        self.add_report_section("call", "requirement", finding.sentence())
        if finding.verdict != HOLDS:
            raise RequirementError(finding.sentence())

    def repr_failure(self, excinfo: pytest.ExceptionInfo[BaseException], style: Any = None) -> Any:
        """Return the sentence alone; a traceback says nothing about a requirement."""
        if isinstance(excinfo.value, RequirementError):
            return str(excinfo.value)
        return super().repr_failure(excinfo, style)

    def reportinfo(self) -> tuple[Path, None, str]:
        """Return where it is."""
        return self.path, None, f"requirement: {self.name}"
