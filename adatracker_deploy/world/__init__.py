"""The simulated world that rehearsal and learning share: scenes, people, ray-cast camera, episodes."""
