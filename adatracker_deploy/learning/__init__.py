"""Training (needs the train extra); nothing that runs on a robot imports it.

Episodes: `embodiment` and `episode_spec` define one, `conditions` defines those for evaluation, `tracking`
and `environment` step it, `expert` solves it, and `seeds` keeps training and evaluation apart. `data`
collects and serves episodes. Policies: `networks`, `checkpoint`, and `export`.
"""
