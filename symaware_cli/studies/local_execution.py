"""The executor `local`, which executes runs in this process or in worker processes on this machine."""

from __future__ import annotations

from contextlib import AbstractContextManager

from symaware_cli.studies.executor import Executor
from symaware_cli.studies.folder import SweepWork
from symaware_cli.studies.row import Row
from symaware_cli.studies.sweep_error import SweepError
from symaware_cli.studies.sweep_execution import SweepExecution, SweepTask
from symaware_cli.studies.worker_pool import executor_of


class LocalExecution(SweepExecution):
    """Runs on this machine."""

    def executor(self, task: SweepTask) -> AbstractContextManager[Executor[Row]]:
        """Return an executor of worker processes or, with 0 jobs, of this process."""
        if task.address:
            raise SweepError(f"`local` has no address, such as `{task.address}`")
        work = SweepWork(str(task.folder.path), task.batch)
        return executor_of(work, min(task.jobs, task.count), task.folder.plan.document.timeout)
