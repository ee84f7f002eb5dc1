/* How the functions that other programs load are marked; all others stay inside the library. */
#ifndef EXPORTED_H
#define EXPORTED_H

#if defined(_WIN32)
#define PUBLIC __declspec(dllexport)
#elif defined(__GNUC__)
#define PUBLIC __attribute__((visibility("default")))
#else
#define PUBLIC
#endif

#endif
