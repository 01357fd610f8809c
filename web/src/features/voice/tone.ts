/** A short tone for warnings, for people who do not want a voice. */

const TONE_S = 0.25;
let context: AudioContext | undefined;

export function playTone(): void {
  if (!('AudioContext' in globalThis)) return;
  context ??= new AudioContext();
  void context.resume(); // a browser is silent until the person has used the page
  const [tone, gain] = [context.createOscillator(), context.createGain()];
  tone.frequency.value = 880;
  gain.gain.setValueAtTime(0.2, context.currentTime);
  gain.gain.exponentialRampToValueAtTime(0.001, context.currentTime + TONE_S);
  tone.connect(gain).connect(context.destination);
  tone.start();
  tone.stop(context.currentTime + TONE_S);
}
