# SPDX-License-Identifier: Apache-2.0
"""`make reproduce`: the paper's tables and figures made anew, and what they were made with.

`plan` says what is run (`plan.yaml`), `run` runs it, `record` notes how, `results` reads what came out, and
`report` writes it down in docs/results.md.
"""
