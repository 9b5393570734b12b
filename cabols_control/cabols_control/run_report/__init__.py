# SPDX-License-Identifier: Apache-2.0
"""A recorded run, read from its bag: figures of merit, acceptance, pictures, report."""
