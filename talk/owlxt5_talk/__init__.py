# SPDX-License-Identifier: Apache-2.0
"""A page in the browser to talk to the simulated robot NICO: `owlxt5-talk` (docs/talk.md)."""
