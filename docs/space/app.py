# SPDX-License-Identifier: Apache-2.0
"""The page of `owlxt5-talk` as a Hugging Face Space: a Space is reached from outside, at port 7860."""

import sys

from owlxt5_talk.cli import main

if __name__ == "__main__":
    sys.argv[1:] = ["--host=0.0.0.0", "--port=7860", "--visitors=2"]
    main()
