"""Identification of electromechanical systems: from a record of voltage and speed to a model you can trust.

The names listed in ``__init__.pyi`` are the library; each is imported when it is first used, so that ``import emsid``
and ``emsid --help`` load neither compiler nor plotting library.
"""

from functools import partial
from importlib import import_module

import lazy_loader

from emsid.presentation import analyse_with, present_with
from emsid.renamed import with_old_names

__version__ = "0.1.0"

_present, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
RENAMED = {
    "GreyBox": "PlantModel",
    "DrivenMotor": "MotorPlant",
    "Narx": "RegressionModel",
    "assess": "validate",
    "assess_model": "validate",
    "spectrum": "frequency_response",
    "Spectrum": "FrequencyResponse",
}
"""The present name for every old one."""
FREE_RUN = "emsid.fit(emsid.arx(na, nb, nk), record, free_run=True)"
OF_MATLAB = {
    "iddata": "emsid.Record(input, output, dt)",
    "merge": "emsid.concatenate(records)",
    "detrend": "record.detrend()",
    "idresamp": "record.resample(…)",
    "resample": "record.decimate(n)",
    "idfilt": "record.lowpass(hz)",
    "setpvec": "fit.with_parameters(…)",
    "setpar": "fit.with_parameters(…)",
    "idproc": "emsid.process_model()",
    "tfestimate": "emsid.frequency_response(record)",
    "idinput": "a signal of emsid.excitation",
    "oe": FREE_RUN,
    "output_error": FREE_RUN,
    "tfest": "emsid.fit(emsid.transfer_function(poles, zeros), record)",
    "idtf": "emsid.TransferFunction",
    "idfrd": "emsid.FrequencyResponse",
    "procest": "emsid.fit(emsid.process_model(), record)",
    "bj": "emsid.fit(emsid.box_jenkins(…), record)",
    "polyest": "emsid.fit(emsid.box_jenkins(…), record)",
    "idpoly": "emsid.PolynomialModel",
    "iv4": "emsid.fit(emsid.arx(na, nb, nk), record, instruments=True)",
    "n4sid": "emsid.fit(emsid.state_space(order), record)",
    "ssest": "emsid.fit(emsid.state_space(order), record)",
    "ssregest": "emsid.fit(emsid.state_space(order), record)",
    "pem": "emsid.fit(model, record)",
    "idss": "emsid.StateSpaceModel",
    "nlarx": "emsid.fit(emsid.polynomial_narx(…), record)",
    "idnlarx": "emsid.RegressionModel",
    "nlhw": "emsid.fit(emsid.hammerstein_wiener(…), record)",
    "idnlhw": "emsid.Cascade",
    "greyest": "emsid.fit(emsid.plants.rigid_motor(), record)",
    "nlgreyest": "emsid.fit(emsid.plants.rigid_motor(), record)",
    "idnlgrey": "a plant of emsid.plants, or emsid.OwnPlant",
    "idgrey": "a plant of emsid.plants, or emsid.OwnPlant",
    "rarx": "emsid.recursive_least_squares(…)",
    "recursiveARX": "emsid.RecursiveLeastSquares",
    "resid": "emsid.residuals(model, record).plot()",
    "sim": "emsid.simulate(model, record)",
    "lsim": "emsid.simulate(model, record)",
    "bodeplot": "emsid.bode(models).plot()",
    "bodemag": "emsid.bode(models).plot()",
    "stepplot": "emsid.step(models).plot()",
    "impulseplot": "emsid.impulse(models).plot()",
    "pzmap": "emsid.pole_map(models).plot()",
    "iopzmap": "emsid.pole_map(models).plot()",
    "pole": "emsid.poles(model)",
    "zero": "emsid.zeros(model)",
    "spa": "emsid.frequency_response(record)",
    "etfe": "emsid.frequency_response(record)",
    "d2c": "emsid.to_continuous(model)",
    "c2d": "emsid.to_discrete(model, dt)",
    "d2d": "emsid.to_discrete(model, dt)",
    "pexcit": "emsid.persistent_excitation_order(record)",
    "delayest": "emsid.identify(record), which finds the delay",
    "arxstruc": "the command emsid orders",
    "selstruc": "the command emsid orders",
    "goodnessOfFit": "emsid.validate(model, record)",
    "getpvec": "fit.to_frame()",
    "present": "print(fit)",
    "systemIdentification": "the command emsid studio",
}
"""What to write here for the functions of MATLAB's System Identification Toolbox."""
__getattr__ = with_old_names(__name__, _present, RENAMED, OF_MATLAB)

present_with(partial(import_module, "emsid.report.notebook"))
analyse_with(partial(import_module, "emsid.validation.analysis"))
