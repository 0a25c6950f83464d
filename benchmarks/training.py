"""Speed of training: updates of each method and variant, and steps visited by a policy.

Run with ``python benchmarks/training.py [--threads N] [--device cuda] [--bfloat16]``; a few updates of a full
batch on freshly collected data. On the CPU, times are of the processor, so that a busy machine counts little.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch

from adatracker_deploy.learning.data.collect import collect
from adatracker_deploy.learning.data.dataset import Dataset
from adatracker_deploy.learning.data.recipe import load_recipe
from adatracker_deploy.learning.data.visit import visit
from adatracker_deploy.learning.train.agent import Agent, Sequences
from adatracker_deploy.learning.train.awr import Awr
from adatracker_deploy.learning.train.cql_sac import CqlSac
from adatracker_deploy.learning.train.dagger import Dagger
from adatracker_deploy.learning.train.settings import TrainSettings
from adatracker_deploy.learning.train.visitor import Visitor

RECIPE = "deploy"
WARM_UP, UPDATES = 2, 8


def now_s(device: torch.device) -> float:
    if device.type == "cpu":
        return time.process_time()
    torch.cuda.synchronize(device)
    return time.perf_counter()


def updates(dataset: Dataset, settings: TrainSettings, device: torch.device) -> None:
    agent = Agent(settings.config()).to(device)
    learner = {"cql_sac": CqlSac, "awr": Awr, "dagger": Dagger}[settings.method](agent, settings)
    if settings.belief or settings.response:
        dataset = dataset.told(believes=settings.belief, responds=settings.response)
    learner.prepare(dataset, print)
    for number in range(WARM_UP + UPDATES):
        if number == WARM_UP:
            begin_s = now_s(device)
        batch = dataset.sample(np.random.default_rng(number), settings.batch, settings.length, history=16)
        learner.update(Sequences.of(batch).to(device), number)
    taken_s = (now_s(device) - begin_s) / UPDATES
    steps = settings.batch * settings.length / taken_s
    name = " ".join((settings.method, *settings.variants))
    print(f"{name:28s} {1e3 * taken_s:6.0f} ms an update, {steps:6.0f} steps/s")


def visits(steps: int, envs: int) -> None:
    visitor = Visitor(Agent(TrainSettings(recipe=RECIPE).config()))
    begin_s = time.process_time()
    for _ in visit(load_recipe(RECIPE), visitor, steps=steps, seed=0, envs=envs):
        pass
    print(
        f"visits of {envs:3d} episodes at once: {steps / (time.process_time() - begin_s):6.0f} steps/s a core"
    )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--batch", type=int, default=16)
    parser.add_argument("--bfloat16", action="store_true")
    arguments = parser.parse_args()
    torch.set_num_threads(arguments.threads)
    plain = TrainSettings(recipe=RECIPE, batch=arguments.batch, bfloat16=arguments.bfloat16)
    with tempfile.TemporaryDirectory() as scratch:
        collect(load_recipe(RECIPE), Path(scratch), steps=3000)
        collected = Dataset.open([Path(scratch)])
    offline = replace(plain, method="awr", critic_updates=20, belief=True)
    for each in (
        plain,
        replace(plain, variants=("no-encoder",)),
        offline,
        replace(plain, method="cql_sac"),
    ):
        updates(collected, each, torch.device(arguments.device))
    visits(3200, 32)
