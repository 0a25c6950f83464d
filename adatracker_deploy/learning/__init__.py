"""The training side (needs the train extra); nothing that runs on a robot imports it.

Episodes: `embodiment`, `noise` and `episode_spec` say what one is, `conditions` which ones policies are
compared on, `tracking` and `environment` step it, `expert` masters it, and `seeds` keeps training and
evaluation apart. `data` collects and serves them. Policies: `networks`, `checkpoint`, and `export`.
"""
