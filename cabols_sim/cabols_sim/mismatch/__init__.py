# SPDX-License-Identifier: Apache-2.0
"""A robot with effects that a model of joint stiffness leaves out, drawn by a seed.

Nothing that identifies may import it: its settings are the truth that is looked for.
"""
