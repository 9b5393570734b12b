# SPDX-License-Identifier: Apache-2.0
"""Client of an ABB controller: EGM feedback, RWS, the stored configurations."""
