// SPDX-License-Identifier: Apache-2.0
// What stgs_mpi.so offers: MPI behind functions of plain C, so that the program itself is not
// linked to an MPI. Which MPI that is, and how its numbers and handles look, the module alone
// knows.
#pragma once

#include <cstddef>

namespace stgs::encoder {

// One thread calls. All but describe and abort return 0, or an error of MPI for describe.
struct MpiFunctions {
  int (*init)(int* rank, int* size, int* node_rank, int* node_size);
  // One gather at a time, all of it in the background; `bytes` is a multiple of 4. The buffers are
  // MPI's until gather_done has set `done`.
  int (*gather_begin)(const void* own, std::size_t bytes, void* all);
  int (*gather_done)(int* done);
  // A note to every other rank, on a channel of its own. `bytes` stays as it is until finalize.
  int (*note_send)(const void* bytes, std::size_t n);
  // The next note that has come, of n bytes; `from` is -1 where there is none.
  int (*note_poll)(int* from, void* bytes, std::size_t n);
  int (*finalize)();
  // Ends every rank with this exit code.
  void (*abort)(int code);
  void (*describe)(int error, char* text, std::size_t size);
};

// The module's one symbol; its number changes with this struct.
inline constexpr const char* kMpiSymbol = "stgs_mpi_functions_1";
using MpiSymbol = const MpiFunctions* (*)();

}  // namespace stgs::encoder
