// SPDX-License-Identifier: Apache-2.0
// The processes that train one scene together, each on other views: ranks 0 to size - 1, started by
// mpirun or by srun --mpi=pmix. All make the same calls in the same order, from one thread each.
#pragma once

#include <cstddef>
#include <memory>
#include <string>

#include "stgs/format/status.h"

namespace stgs::encoder {

inline constexpr int kMaxRanks = 64;

class Ranks {
 public:
  virtual ~Ranks() = default;
  virtual int rank() const = 0;
  virtual int size() const = 0;
  // Among the ranks on this machine, from 0.
  virtual int node_rank() const = 0;
  // Ranks on this machine, which share its memory and its cores.
  virtual int node_size() const = 0;
  // all (size() x bytes) becomes what each rank gave as `own`, in the order of the ranks. `bytes`
  // is a multiple of 4 and the same on every rank. The error of another rank ends the wait.
  virtual Status all_gather(const void* own, std::size_t bytes, void* all) = 0;
  // The error of another rank that has failed meanwhile, for whoever waits for something else.
  virtual Status check_peers() = 0;
};

// How the environment says that this process was started.
struct Launch {
  int size = 1;          // processes started together
  std::string launcher;  // what started them, for messages; "" where size is 1
};
Launch detect_launch();

// The ranks that mpirun or srun has started, over MPI. The library with MPI in it, stgs_mpi.so, is
// loaded from the program's folder, so that a program that was started alone needs no MPI.
class World : public Ranks {
 public:
  // What all ranks have come to.
  struct Conclusion {
    Status status;               // of the run: the error of the lowest rank that had one of its own
    bool should_report = false;  // this rank is the one that tells it
  };

  // Whether this build has MPI.
  static bool is_built();
  // Null where this process was started alone. kNotBuilt in a build without MPI, kUnsupported where
  // MPI cannot be loaded or does not know of the other processes.
  static Result<std::unique_ptr<World>> join();

  // The end of this rank's work, good or bad: tells the others, who stop waiting for it where it is
  // bad, and waits for theirs. Nothing but finish() comes after it.
  virtual Conclusion conclude(const Status& own) = 0;
  // Leaves MPI; where ranks hang or have stopped in the middle of something, ends them all with the
  // conclusion's exit code and does not return.
  virtual void finish() = 0;
};

}  // namespace stgs::encoder
