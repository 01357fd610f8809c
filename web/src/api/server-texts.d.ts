declare module 'virtual:server-texts' {
  const entries: readonly (readonly [string, string])[];
  export default entries;
}
