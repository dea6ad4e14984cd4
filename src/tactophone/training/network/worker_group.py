"""Data-parallel training under ``torchrun``: each process computes its part of every batch.

The loss is a weighted mean over the whole batch, so each process divides its sum by the weight of the *whole* batch.
The gradients then sum to those of a single process, but for the order of summation.
"""

import os
from dataclasses import dataclass

import torch
from torch import nn


@dataclass(frozen=True, slots=True)
class WorkerGroup:
    """The rank of this process among so many."""

    rank: int = 0
    size: int = 1

    @property
    def leads(self) -> bool:
        """Whether this process writes files and prints."""
        return self.rank == 0

    def part(self, count: int) -> slice:
        """Return this process's part of a batch of ``count`` windows.

        >>> [WorkerGroup(rank, 3).part(10) for rank in range(3)]
        [slice(0, 3, None), slice(3, 6, None), slice(6, 10, None)]
        """
        return slice(self.rank * count // self.size, (self.rank + 1) * count // self.size)

    def all_reduce(self, network: nn.Module, loss: torch.Tensor) -> float:
        """Sum gradients and loss over all processes; return the loss."""
        total = loss.detach().clone()
        if self.size > 1:
            torch.distributed.all_reduce(total)
            for parameter in network.parameters():
                torch.distributed.all_reduce(parameter.grad)
        return float(total)


def init_distributed() -> WorkerGroup:
    """Join the processes that ``torchrun`` started; without it, return a group of one."""
    size = int(os.environ.get("WORLD_SIZE", "1"))
    if size == 1:
        return WorkerGroup()
    if not torch.distributed.is_initialized():
        torch.distributed.init_process_group("gloo")
    return WorkerGroup(torch.distributed.get_rank(), size)
