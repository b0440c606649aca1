"""Compile kernels before the tests, which would each be compiled in three processes.

A kernel that no fit here needs is compiled by the first test that needs it, which costs seconds and is no error.
"""

import emsid
from emsid.estimation.linear.change_detection import ChangeDetector
from emsid.live.tracking import Tracker
from emsid.study.demonstration import motor_record
from emsid.study.workflow import Settings, study
from model_examples import ALL, measured


def main() -> None:
    study(Settings(duration=2.0))
    record = motor_record()[:400]
    emsid.fit(emsid.arx(2, 2), record, free_run=True).model.predict(record, 2)
    emsid.fit(emsid.state_space(2), record, free_run=True)
    emsid.fit(emsid.feedback(1, static="polynomial"), record)
    emsid.select_terms(emsid.polynomial_narx(2, 2, 2), record)
    recursion = emsid.RecursiveLeastSquares(emsid.arx(1, 1))
    emsid.SampleBySample(recursion, record.dt).add(0.0, 0.0)
    tracker = Tracker(recursion, detector=ChangeDetector(run=1e6, settling=100))
    tracker.advance(tracker.start(), record)
    for model in (ALL[name] for name in ALL if "user" not in name and "own" not in name):
        emsid.start(model, record=measured(model)).step(0.0)  # several files do, also with other friction laws


if __name__ == "__main__":
    main()
