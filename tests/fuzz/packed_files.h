// SPDX-License-Identifier: Apache-2.0
// Folders of small files as inputs.
//
// An input is an options line and any number of files: a separator, the name, '\n', and the content
// up to the next separator. No size is stored, so files may grow and shrink, and a file is a unit.
// A name that ends in '/' is an empty folder; one that ends in '@' a symbolic link, whose target is
// the content; one that ends in '|' a pipe.
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "../fixtures/temporary_folder.h"
#include "fuzz_target.h"

namespace stgs::fuzz {

struct PackedFile {
  std::string name;  // relative, with '/'
  std::string content;
};

struct PackedFiles {
  std::string options;  // before the first file
  std::vector<PackedFile> files;
};

Bytes pack_files(const PackedFiles& packed);
PackedFiles unpack_files(View input);
// Returns each file, and its content, as units.
std::vector<Unit> file_units(View input);

// A folder in memory where the system has one (/dev/shm), so that no disk is written. Deleted with
// the object.
class InputFolder {
 public:
  InputFolder();

  // Returns the path of the folder of the input, which has no symbolic links.
  const std::string& path() const { return path_; }
  // Returns a path next to it.
  std::string beside(const std::string& name) const { return root_ / name; }
  // Replaces the content of the folder. Skips names that lead out of it or cannot be created.
  void write(const std::vector<PackedFile>& files) const;

 private:
  const testing::TemporaryFolder root_;
  const std::string path_;
};

// Returns the folder of this program.
const InputFolder& input_folder();

// Returns the path of an open file.
std::string path_of_descriptor(int descriptor);

// Writes a file. Aborts if it cannot.
void write_input(const std::string& path, std::string_view content);

// An uncompressed image without checksums that OpenCV reads: 8-bit BGR of one colour, at most 64
// pixels wide and high.
std::string tiny_bmp(int width, int height, std::uint8_t value);

// Appends numbers in the byte order of the machine.
template <typename T>
void append_value(std::string& bytes, T value) {
  bytes.append(reinterpret_cast<const char*>(&value), sizeof value);
}

}  // namespace stgs::fuzz
