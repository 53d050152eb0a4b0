# SPDX-License-Identifier: Apache-2.0
# Hardening of everything that is built: tests/install/test_hardening.py inspects the results.
# - Stack protector, stack clash protection, checked libc calls (_FORTIFY_SOURCE).
# - Indirect jumps and returns are checked by processors that can (x86: CET, Arm: BTI and PAC).
# - Relocations are resolved at start and then read-only, the stack is not executable.
# - Symbols are hidden except those that are declared visible (STGS_API, the entries of modules).
# nvcc passes the compiler's flags to the host compiler. There is no switch: the cost of decoding is
# below the noise of measurement. Included by compiler.cmake.
include_guard()
include(CheckCompilerFlag)
include(CheckCXXSourceCompiles)
include(CheckPIESupported)

check_pie_supported(OUTPUT_VARIABLE ignored LANGUAGES CXX)
foreach(language C CXX CUDA)
  set(CMAKE_${language}_VISIBILITY_PRESET hidden)
endforeach()
set(CMAKE_VISIBILITY_INLINES_HIDDEN ON)

set(STGS_HARDENING)
foreach(flag -fstack-protector-strong -fstack-clash-protection -fcf-protection=full
             -mbranch-protection=standard)
  string(MAKE_C_IDENTIFIER "STGS_COMPILER_HAS${flag}" has)
  check_compiler_flag(CXX ${flag} ${has})
  if(${has})
    list(APPEND STGS_HARDENING ${flag})
  endif()
endforeach()

# Sanitizers check the same calls, and report more.
set(STGS_FORTIFY)
if(NOT STGS_SANITIZE AND NOT STGS_FUZZER)
  set(CMAKE_REQUIRED_FLAGS "-Werror -O2 -U_FORTIFY_SOURCE -D_FORTIFY_SOURCE=3")
  check_cxx_source_compiles("#include <cstring>\nint main() { return 0; }" STGS_COMPILER_HAS_FORTIFY_3)
  unset(CMAKE_REQUIRED_FLAGS)
  set(level 2)
  if(STGS_COMPILER_HAS_FORTIFY_3)
    set(level 3)
  endif()
  # It needs optimisation. A level that the user or the compiler sets is replaced.
  set(STGS_FORTIFY -U_FORTIFY_SOURCE -D_FORTIFY_SOURCE=${level})
endif()

set(optimised $<CONFIG:Release,RelWithDebInfo,MinSizeRel>)
foreach(flag IN LISTS STGS_HARDENING)
  add_compile_options($<$<COMPILE_LANGUAGE:C,CXX>:${flag}> $<$<COMPILE_LANGUAGE:CUDA>:-Xcompiler=${flag}>)
endforeach()
foreach(flag IN LISTS STGS_FORTIFY)
  add_compile_options($<$<AND:${optimised},$<COMPILE_LANGUAGE:C,CXX>>:${flag}>
                      $<$<AND:${optimised},$<COMPILE_LANGUAGE:CUDA>>:-Xcompiler=${flag}>)
endforeach()
if(CMAKE_EXECUTABLE_FORMAT STREQUAL "ELF")
  add_link_options(LINKER:-z,relro LINKER:-z,now LINKER:-z,noexecstack)
endif()

# stgs_export(TARGET SYMBOLS...): the module exports these symbols alone, not those of the libraries
# and templates in it. A symbol may contain *.
function(stgs_export target)
  list(JOIN ARGN "; " symbols)
  set(map ${CMAKE_CURRENT_BINARY_DIR}/${target}.map)
  file(CONFIGURE OUTPUT ${map} CONTENT "{ global: ${symbols}; local: *; };\n" @ONLY)
  target_link_options(${target} PRIVATE LINKER:--version-script=${map})
  set_property(TARGET ${target} APPEND PROPERTY LINK_DEPENDS ${map})
endfunction()
