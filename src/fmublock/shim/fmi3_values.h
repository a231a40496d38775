/* The types of values of FMI 3.0, but for Strings. */

#ifndef OTHER_TYPE /* an FMU without variables of these types */
#define OTHER_TYPE NEITHER_GET_NOR_SET
#endif

GET_AND_SET(Float64, fmi3Float64, 'R', AS_IT_IS, AS_IT_IS)
GET_AND_SET(Int32, fmi3Int32, 'I', AS_INTEGER, AS_DOUBLE)
GET_AND_SET(Int64, fmi3Int64, 'E', AS_INT64, AS_DOUBLE)
GET_AND_SET(Boolean, fmi3Boolean, 'B', AS_BOOLEAN, AS_TRUTH)
OTHER_TYPE(Float32, fmi3Float32)
OTHER_TYPE(Int8, fmi3Int8)
OTHER_TYPE(UInt8, fmi3UInt8)
OTHER_TYPE(Int16, fmi3Int16)
OTHER_TYPE(UInt16, fmi3UInt16)
OTHER_TYPE(UInt32, fmi3UInt32)
OTHER_TYPE(UInt64, fmi3UInt64)

fmi3Status fmi3GetBinary(fmi3Instance c, const fmi3ValueReference vr[], size_t nvr, size_t sizes[],
                         fmi3Binary values[], size_t n) {
    (void)sizes;
    return prepare_get(c, vr, nvr, '-', values, n);
}

fmi3Status fmi3SetBinary(fmi3Instance c, const fmi3ValueReference vr[], size_t nvr, const size_t sizes[],
                         const fmi3Binary values[], size_t n) {
    (void)sizes;
    return prepare_set(c, vr, nvr, '-', values, n);
}
