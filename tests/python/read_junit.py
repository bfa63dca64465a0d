"""What a parser of JUnit XML that has nothing to do with us finds in a file, as JSON: read_junit.py FILE."""
import json
import sys

from junitparser import Failure, JUnitXml, Skipped

xml = JUnitXml.fromfile(sys.argv[1])
cases = [
    {
        "suite": suite.name,
        "name": case.name,
        "failed": [str(result.message) for result in case.result if isinstance(result, Failure)],
        "skipped": any(isinstance(result, Skipped) for result in case.result),
    }
    for suite in xml
    for case in suite
]
print(json.dumps({"tests": xml.tests, "failures": xml.failures, "cases": cases}))
