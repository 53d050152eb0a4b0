# SPDX-License-Identifier: Apache-2.0
# The plain comments of the C headers as Doxygen takes them: that of the file at the top, those
# before a declaration or a member, those behind one. Comments of /** are left alone.
/SPDX-License-Identifier/b
2s|^/\* |/** @file\n * |
s|^( *)/\* |\1/** |
s|^( *[^ /*].*[;,)}]) */\* |\1 /**< |
s|^( *[A-Z_0-9]+ = [-A-Z_0-9() ]+) */\* |\1 /**< |
s|^(#define [A-Z_0-9]+ [A-Z_0-9]+) */\* |\1 /**< |
# Every struct begins with it; the rules at the top of stgs.h explain it.
s|^( *size_t struct_size;)$|\1 /**< sizeof the struct, set by the caller. */|
# The enumerators of an integer type are in an enum without a name.
/^typedef int32_t [a-z_]+;/h
/^enum \{$/{
x
s|^typedef int32_t ([a-z_]+);.*|/** Values of \1. */|
G
}
