# SPDX-License-Identifier: Apache-2.0
# The headers' plain comments as Doxygen takes them: the page's at the top, those before a
# declaration or a field, those behind one. The licence and lines of dashes are left alone.
/SPDX-License-Identifier/b
2s|^/\* |/** @file\n * |
/\/\* ---/b
s|^( *)/\* |\1/** |
s|^( *[^ /*].*[;,)}]) */\* |\1 /**< |
s|^( *[A-Z_0-9]+ = [-A-Z_0-9() ]+) */\* |\1 /**< |
