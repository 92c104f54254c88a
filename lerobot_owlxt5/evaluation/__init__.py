# SPDX-License-Identifier: Apache-2.0
"""What  measures: metrics, scoring, report."""
