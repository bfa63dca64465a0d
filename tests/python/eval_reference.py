"""The metrics of src/eval by independent means: scikit-learn, scipy and numpy.

Reads the case file named on the command line, writes the answers to stdout, both JSON. NaN is null.
Where a measure isn't defined the answer is null.
"""

import json
import sys

import numpy as np
from scipy import stats
from sklearn import metrics


def array(values):
    return np.array([np.nan if value is None else value for value in values], dtype=float)


def score(case):
    truth, estimate = array(case["truth"]), array(case["estimate"])
    scored = np.isfinite(truth) & np.isfinite(estimate)
    truth, estimate = truth[scored], estimate[scored]
    touch, detected = truth >= 2.5, estimate >= 2.5
    answer = {
        "n_scored": int(scored.sum()),
        "ba": metrics.balanced_accuracy_score(touch, detected),
        "f1": metrics.f1_score(touch, detected),
        "mae": metrics.mean_absolute_error(truth, estimate),
        "r2": metrics.r2_score(truth, estimate),
    }

    # A bin's balanced accuracy is that of its frames together with all frames without touch.
    edges = np.concatenate([[2.5], np.arange(10.0, truth.max() + 20.0, 10.0)])
    which = np.digitize(truth, edges) - 1
    centres, accuracies, errors = [], [], []
    for bin_idx in range(len(edges) - 1):
        in_bin = which == bin_idx
        if not in_bin.any():
            continue
        either = in_bin | ~touch
        centres.append((edges[bin_idx] + edges[bin_idx + 1]) / 2)
        accuracies.append(metrics.balanced_accuracy_score(touch[either], detected[either]))
        errors.append(metrics.mean_absolute_error(truth[in_bin], estimate[in_bin]))
    answer["centres"], answer["accuracies"], answer["errors"] = centres, accuracies, errors

    above = np.flatnonzero(np.array(accuracies) >= 0.9)
    answer["mdf"] = None
    if len(above) and above[0] > 0:
        pair = slice(above[0] - 1, above[0] + 1)
        answer["mdf"] = float(np.interp(0.9, accuracies[pair], centres[pair]))
    return answer


def paired(case):
    differences = array(case["differences"])
    nonzero = differences[differences != 0]
    # scipy's "exact" is that of ranks without ties; the permutation of all signs is exact with ties too.
    every_sign = stats.PermutationMethod(n_resamples=np.inf)
    permuted = stats.wilcoxon(nonzero, alternative="greater", method=every_sign)
    answer = {"p": float(permuted.pvalue), "w_plus": float(permuted.statistic)}
    if len(np.unique(np.abs(nonzero))) == len(nonzero):
        exact = stats.wilcoxon(differences, alternative="greater", method="exact", zero_method="wilcox")
        answer["p_exact"] = float(exact.pvalue)
    answer["d_z"] = float(differences.mean() / differences.std(ddof=1))
    answer["quantiles"] = [float(q) for q in np.quantile(differences, [0.05, 0.5, 0.95])]
    return answer


def tared(case):
    stamps, force = np.array(case["stamps_ns"], dtype=float), array(case["force"])
    at, tare = [], []
    for begin, end in case["zero_load_ns"]:
        inside = (stamps >= begin) & (stamps < end) & np.isfinite(force)
        at.append((stamps[inside].min() + stamps[inside].max()) / 2)
        tare.append(np.median(force[inside]))
    return {"tared": [None if np.isnan(f) else float(f) for f in force - np.interp(stamps, at, tare)]}


with open(sys.argv[1], encoding="utf-8") as file:
    cases = json.load(file)
answers = {
    "scores": [score(case) for case in cases["scores"]],
    "paired": [paired(case) for case in cases["paired"]],
    "tared": [tared(case) for case in cases["tared"]],
}
json.dump(answers, sys.stdout, allow_nan=False)
