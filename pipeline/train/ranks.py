"""Several processes that train one network together."""

from __future__ import annotations

from pathlib import Path

import torch


def join(meeting: Path, rank: int, ranks: int) -> None:
    """Wait until all processes are there; ``meeting`` a file that does not exist yet."""
    if ranks > 1:
        torch.distributed.init_process_group(
            "gloo", init_method=f"file://{meeting.resolve()}", rank=rank, world_size=ranks
        )


def share_gradients(net: torch.nn.Module, ranks: int) -> None:
    """Give every process the mean of all processes' gradients."""
    if ranks < 2:
        return
    gradients = [p.grad for p in net.parameters() if p.grad is not None]
    flat = torch.cat([g.flatten() for g in gradients])
    torch.distributed.all_reduce(flat)
    flat /= ranks
    at = 0
    for gradient in gradients:
        gradient.copy_(flat[at : at + gradient.numel()].view_as(gradient))
        at += gradient.numel()


def follow(mean: torch.nn.Module, net: torch.nn.Module, share: float) -> None:
    """Move the running mean of the weights towards the current ones."""
    with torch.no_grad():
        ours, theirs = mean.state_dict(), net.state_dict()
        moving = [key for key, value in ours.items() if value.dtype.is_floating_point]
        torch._foreach_lerp_([ours[k] for k in moving], [theirs[k] for k in moving], share)
        for key in ours.keys() - set(moving):
            ours[key].copy_(theirs[key])
