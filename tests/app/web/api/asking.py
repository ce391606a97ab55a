"""What tests ask the service for, and how they wait for it."""

import time

ASK = {
    "stiffness_set_1": "1",
    "stiffness_set_2": "3",
    "trials": 20,
    "startup_trials": 10,
    "candidates": 2,
}
PLACE = {"pillar_radius_um": 7.0, "gap_um": 16.0, "periodicity": 6, "deformation_index": 0.6}
LIMIT_S = 240


def finished(client, url, wanted=("done", "failed", "ready", "cancelled")):
    """The answer once its state is one of those wanted."""
    end = time.monotonic() + LIMIT_S
    while time.monotonic() < end:
        answer = client.get(url).json()
        if answer["state"] in wanted:
            return answer
        time.sleep(0.1)
    raise AssertionError(f"not finished after {LIMIT_S} s: {answer}")
